"""Finds and loads liblookout.so."""

import ctypes
import os
import pathlib

from . import _layout


def _candidates():
    named = os.environ.get("LOOKOUT_LIBRARY")
    if named:
        # Whoever names a library gets that one or an error.
        return [named]
    beside = sorted(pathlib.Path(__file__).parent.glob("liblookout.so*"))
    return [*map(str, beside), f"liblookout.so.{_layout.LAYOUT}", "liblookout.so"]


def load():
    """The library.

    Raises OSError if there is none, or one with another layout of the structures.
    """
    failures = []
    for path in _candidates():
        try:
            library = ctypes.CDLL(path)
        except OSError as error:
            failures.append(str(error))
            continue
        library.lookout_layout.restype = ctypes.c_uint32
        layout = library.lookout_layout()
        if layout != _layout.LAYOUT:
            failures.append(f"{path} has layout {layout}, this package has {_layout.LAYOUT}: use one release of both")
            continue
        library.lookout_open.restype = ctypes.c_void_p
        library.lookout_open.argtypes = [ctypes.POINTER(_layout.Options), ctypes.c_char_p, ctypes.c_size_t]
        library.lookout_next.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.POINTER(_layout.Frame)]
        library.lookout_error.restype = ctypes.c_char_p
        library.lookout_error.argtypes = [ctypes.c_void_p]
        library.lookout_close.restype = None
        library.lookout_close.argtypes = [ctypes.c_void_p]
        library.lookout_level_name.restype = ctypes.c_char_p
        library.lookout_level_name.argtypes = [ctypes.c_uint32]
        return library
    raise OSError(
        "liblookout.so cannot be loaded: build it (cargo build --release -p lookout-client-c) and name it with "
        "LOOKOUT_LIBRARY, or install it (clients/c/install.sh): " + "; ".join(failures)
    )
