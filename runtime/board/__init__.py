"""A real board on a serial line: link G of the chain (``pil``), and recording what it sends (``record``)."""
