"""Wrong rewriting: the passes; sine and cosine, small angles."""

from __future__ import annotations

from tests.mutants.catalogue.rewriting import COUNTED, PAPER, PIPELINE, SMALL, TRIG, of, pass_checks

PASS = (
    *of(
        "passes",
        "codegen/passes/signs.py",
        (
            "sign of a difference lost",
            '(args[1][0] != (node.op == "sub"), args[1][1])',
            "(args[1][0], args[1][1])",
            pass_checks("signs"),
        ),
        (
            "sign of a product lost",
            "return args[0][0] != args[1][0], new.op(node.op",
            "return args[0][0], new.op(node.op",
            pass_checks("signs"),
        ),
        (
            "both negative",
            'return a[0], new.op("add", a[1], b[1])',
            'return False, new.op("add", a[1], b[1])',
            pass_checks("signs"),
        ),
        (
            "difference the wrong way round",
            "first, second = (b, a) if a[0] else (a, b)",
            "first, second = (a, b)",
            pass_checks("signs"),
        ),
        (
            "root's sign lost",
            'signed[index] = False, new.op("neg", value)',
            "signed[index] = False, value",
            pass_checks("signs"),
        ),
    ),
    *of(
        "passes",
        "codegen/ir/constants.py",
        (
            "constants added",
            "value = math.prod(graph[index].value for index in constants)",
            "value = sum(graph[index].value for index in constants)",
            pass_checks("share_products"),
        ),
    ),
    *of(
        "passes",
        "codegen/passes/__init__.py",
        ("pass forgotten in what is done", "key = (id(graph), roots, step)", "key = (id(graph), roots)", PIPELINE),
        ("roots forgotten in what is done", "key = (id(graph), roots, step)", "key = (id(graph), step)", PIPELINE),
        (
            "dearest way",
            "best = min(",
            "best = max(",
            pass_checks("share_products")[1:],
        ),
        (
            "last pass twice",
            "graph, roots = self.run(passes[:-1])\n            new",
            "graph, roots = self.run(passes[:-2])\n            new",
            PIPELINE,
        ),
    ),
    *of(
        "passes",
        "codegen/passes/collect.py",
        ("sign of a product of sums", "return [(a != b, [*p, *q])", "return [(a, [*p, *q])", pass_checks("collect")),
        (
            "terms behind a minus",
            '[(negative != (node.op == "sub"), factors) for',
            "[(negative, factors) for",
            pass_checks("collect"),
        ),
        (
            "factor taken out twice",
            "rest.remove(factor)",
            "rest = [f for f in rest if f != factor]",
            pass_checks("collect"),
        ),
        (
            "sign of what is collected",
            "rests = [(negative != flip, list(",
            "rests = [(negative, list(",
            pass_checks("collect"),
        ),
        (
            "common factor left in",
            "list((Counter(factors) - common).elements())",
            "list(factors)",
            pass_checks("collect"),
        ),
        ("common factor of the first term alone", "common &= Counter(factors)", "pass", COUNTED),
        (
            "common factor goes in",
            "common = Counter(other for other in inner[0][1] if other in others)",
            "common = Counter[int]()",
            COUNTED,
        ),
        ("empty product is 0", "return self.new.const(1.0)", "return self.new.const(0.0)", pass_checks("collect")),
        (
            "all negative",
            'return self.new.op("neg", self._added([(False, value) for _, value in terms]))',
            "return self._added([(False, value) for _, value in terms])",
            pass_checks("collect"),
            "not reached: a sum's leftmost term is positive, and collecting keeps the sign of the first it takes",
        ),
    ),
    *of(
        "passes",
        "codegen/passes/products.py",
        (
            "a factor once",
            "found[index] = found.get(index, 0) + 1",
            "found[index] = 1",
            pass_checks("share_products"),
        ),
        (
            "constants forgotten",
            "return found if number.value == 1.0 else found | {self._number(number): 1}",
            "return found",
            pass_checks("share_products"),
        ),
        ("pair put in once too seldom", "held[made] = times", "held[made] = 1", pass_checks("share_products")),
    ),
    *of(
        "passes",
        "codegen/passes/reciprocals.py",
        (
            "divisor for dividend",
            'new.op("div", new.const(1.0), args[1])',
            'new.op("div", new.const(1.0), args[0])',
            pass_checks("reciprocals"),
        ),
        (
            "two is one",
            "graph.nodes[inverse.args[0]].value == 1.0",
            "graph.nodes[inverse.args[0]].value > 0.0",
            pass_checks("reciprocals"),
        ),
        (
            "reciprocal spent as it stands",
            'new.op("div", moved[a], moved[inverse.args[1]])',
            'new.op("mul", moved[a], moved[inverse.args[1]])',
            pass_checks("reciprocals"),
        ),
    ),
    *of(
        "passes",
        "codegen/passes/reuse.py",
        (
            "constants need not agree",
            "math.isclose(one * parts[second][0], number, rel_tol=SAME)",
            "True",
            pass_checks("reuse_products"),
        ),
        (
            "constant of a product lost",
            "number *= node.value",
            "number = node.value",
            ("pytest tests/codegen/test_passes.py -k all_constants",),
        ),
        (
            "a factor left over",
            "rest = _without(factors, some)",
            "rest = some",
            pass_checks("reuse_products"),
        ),
    ),
)
ARITHMETIC = (
    *of(
        "sine and cosine",
        "codegen/ir/trig.py",
        ("S_0", "-0.041666642741263902", "-0.041666742741263902", TRIG),
        ("S_2's sign", "-3.0947836252608927e-06", "3.0947836252608927e-06", TRIG),
        ("C_1", "0.0026039993409279051", "0.0026038993409279051", TRIG),
        (
            "parity forgotten",
            'g.op("mul", g.const(2.0), g.op("mul", odd, odd))',
            'g.op("mul", g.const(0.0), g.op("mul", odd, odd))',
            TRIG,
        ),
        ("half for r^2 / 2", 'g.op("mul", g.const(0.5), z)', 'g.op("mul", g.const(0.49999), z)', TRIG),
        ("pi's tail", "_PI_TAIL = 1.2246467991473532e-16", "_PI_TAIL = 1.2246467991473532e-15", TRIG),
        (
            "pi's second part lost",
            "return first, float(np.float32(math.pi - first + _PI_TAIL))",
            "return first, 0.0",
            TRIG,
        ),
        (
            "period for half a period",
            "two_pi = tuple(2 * part for part in split_pi(precision))",
            "two_pi = split_pi(precision)",
            TRIG,
        ),
        (
            "pi itself reached",
            "return float(np.nextafter(np.float32(math.pi), np.float32(0)))",
            "return float(np.nextafter(np.float32(math.pi), np.float32(4)))",
            TRIG,
        ),
        (
            "Horner backwards",
            "value = g.const(coefficients[-1])\n    for c in reversed(coefficients[:-1])",
            "value = g.const(coefficients[0])\n    for c in coefficients[1:]",
            TRIG,
        ),
        ("lower end cut", 'g.op("min", r, bound), lower)', 'g.op("min", r, bound), g.const(0.0))', TRIG),
        ("inside beyond pi", "INSIDE = 9.8696\n", "INSIDE = 9.8756\n", TRIG),
        (
            "inside and outside exchanged",
            'g.const(INSIDE, "INSIDE"), x, outside)',
            'g.const(INSIDE, "INSIDE"), outside, x)',
            TRIG,
        ),
        ("rounds to twice as coarse", "return 1.5 * 2.0 ** (self.bits - 1)", "return 1.5 * 2.0 ** self.bits", TRIG),
    ),
    *of(
        "sine and cosine",
        "codegen/ir/small_angle.py",
        ("sinc's first", "-0.16664553389661672", "-0.16664583389661672", SMALL),
        ("cosm1's third", "-0.0013704120390129683", "-0.0013604120390129683", SMALL),
        (
            "n in one power only",
            "s * n**k for k, s in enumerate(sinc, 1)",
            "s * n for k, s in enumerate(sinc, 1)",
            SMALL,
        ),
        ("series' factorial", "math.factorial(2 * k + 1)", "math.factorial(2 * k)", SMALL),
        (
            "sinc about 0",
            'g.op("mul", polynomial(g, z, s), z), g.const(1.0))',
            'g.op("mul", polynomial(g, z, s), z), g.const(0.0))',
            PAPER,
        ),
        ("too wide a polynomial", "LIMIT = 0.5\n", "LIMIT = 2.0\n", SMALL),
        ("the wide sinc's last", "-2.0772646253426672e-08", "-2.0872646253426672e-08", SMALL),
        ("the wide cosm1's second", "0.04166500500238244", "0.04165500500238244", SMALL),
        ("one term short", "16 if wide else 10)", "16 if wide else 5)", SMALL),
        ("wide ones with the small ones' terms", "16 if wide else 10)", "10)", SMALL),
    ),
)
