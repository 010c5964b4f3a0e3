"""Forward and inverse regression: the thesis' equations, and the field model that holds on unseen lumps."""
