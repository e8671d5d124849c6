"""ROS 2 definitions as OMG IDL, laid out as rosidl writes them and rosbag2 concatenates them (encoding ros2idl)."""

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

_TYPES = {"float64": "double", "bool": "boolean"}
# Comments and defaults as rosidl writes them: with quotes, braces and semicolons that are no syntax.
_COMMENT = """      @verbatim (language="comment", text=
        "See \\"REP 103\\"; valid in the range [0, 1e9)" "\\n"
        "https://design.ros2.org/articles/{name}.html;")
"""


def definition(name: str) -> str:
    """The schema text of a message type and of all types in it."""
    fielddefs = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    needed = [name]
    for part in needed:
        needed += [used for used in map(_used, fielddefs[part][1]) if used and used not in needed]
    return "".join(f"{'=' * 80}\nIDL: {part}\n{_part(part, fielddefs[part][1])}" for part in needed)


def _used(field: tuple) -> str:
    """The message type that a field has, if any."""
    kind, of = field[1]
    element = (kind, of) if kind in (Nodetype.BASE, Nodetype.NAME) else of[0]
    return element[1] if element[0] == Nodetype.NAME else ""


def _part(name: str, fields: list) -> str:
    package, _, short = name.split("/")
    includes = "".join(f'#include "{used}.idl"\n' for used in sorted({_used(f) for f in fields} - {""}))
    typedefs, members = "", ""
    for number, (field, (kind, of)) in enumerate(fields):
        element, base = (kind, of) if kind in (Nodetype.BASE, Nodetype.NAME) else of[0]
        kind_name = _TYPES.get(base[0], base[0]) if element == Nodetype.BASE else base.replace("/", "::")
        if kind == Nodetype.ARRAY:
            alias = f"{kind_name}__{of[1]}"
            typedef = f"    typedef {kind_name} {alias}[{of[1]}];\n"
            typedefs += typedef if typedef not in typedefs else ""
            kind_name = alias
        elif kind == Nodetype.SEQUENCE:
            kind_name = f"sequence<{kind_name}>"
        before = _COMMENT.format(name=short) if number == 0 else ""
        before += "      @default (value=0.0)\n" if kind_name == "double" else ""
        members += f"{before}      {kind_name} {field};\n\n"
    return (
        f"// generated from rosidl_adapter/resource/msg.idl.em\n// with input from {name}.msg\n{includes}\n"
        f"module {package} {{\n  module msg {{\n{typedefs}    struct {short} {{\n{members}    }};\n  }};\n}};\n"
    )
