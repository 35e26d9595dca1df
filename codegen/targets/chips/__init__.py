"""One file a target. Its name is the target's; its ``TARGET`` is the description. Nothing else lists them."""
