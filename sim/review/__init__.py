"""Reading recordings and looking at them."""
