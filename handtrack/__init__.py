"""handtrack: the full 3D pose of a hand, by fitting an articulated model to what calibrated cameras saw.

The public names stand in __init__.pyi. Each is loaded when first used, so that `import handtrack` is quick.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
