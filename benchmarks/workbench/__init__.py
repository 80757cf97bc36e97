"""How long the page of `rodgen open` takes to show, and to draw its plots again after an action."""
