"""The intermediate representation: graphs of operations, blocks made of them, and their named, ordered listings."""
