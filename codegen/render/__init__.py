"""From listings to text: printers, one a language, and the templates around what they print."""
