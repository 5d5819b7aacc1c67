"""Commands about lists: check, show, diff, convert, objects."""
