"""The compiled core: stages of the front-end and the estimators as functions of arrays, in C++.

Each stage has its own file, whose first line describes it; `_core.pyi` has the functions as Python calls them. The
stages do not depend on Python: `bind_*.cpp` name and describe their arguments, `binding.hpp` checks arrays and reads
records by the names of their fields, and stages run without Python's lock. `bind_messages.cpp` is no stage: it writes
the messages of ROS 2 as bytes. The same arrays give the same bytes on every machine of the same architecture, in one
thread or in several.
"""

import os

if os.path.exists(os.path.join(os.path.dirname(__file__), "CMakeLists.txt")):  # a wheel has no sources
    from . import checkout

    __path__.insert(0, checkout.folder_of_module(os.path.dirname(__file__)))  # where Python looks for `_core`

from ._core import *  # noqa: F403 `help` describes each
