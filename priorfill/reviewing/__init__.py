"""How does a user accept, refuse or repeat fills? A page on this computer, and its server."""
