"""Types of message fields in words that are independent of the language."""

from typing import Any

from msgspec import inspect


def field_type(annotation: Any) -> str:
    """The type in words, as `int, 0 to 8192` or `map of str to float, at most 256`.

    Raises:
        TypeError: a type that `_text` does not know yet.
    """
    return _text(inspect.type_info(annotation))


def _text(kind: inspect.Type) -> str:
    match kind:
        case inspect.IntType() | inspect.FloatType():
            name = "int" if isinstance(kind, inspect.IntType) else "float"
            return f"{name}{_range(kind.ge, kind.le)}"
        case inspect.StrType(pattern=pattern) if pattern:
            return f"str, `{pattern}`"
        case inspect.StrType():
            return f"str{_at_most(kind.max_length)}"
        case inspect.BoolType():
            return "bool"
        case inspect.MemoryViewType() | inspect.BytesType():
            return "bin"
        case inspect.LiteralType():
            return " or ".join(f"`{value}`" for value in kind.values)
        case inspect.TupleType():
            return f"array of {len(kind.item_types)} {_text(kind.item_types[0])}"
        case inspect.ListType():
            return f"array of ({_text(kind.item_type)}){_at_most(kind.max_length)}"
        case inspect.DictType():
            key, value = _text(kind.key_type), _text(kind.value_type)
            return f"map of ({key}) to ({value}){_at_most(kind.max_length)}"
        case inspect.StructType():
            return ", ".join(f"`{f.encode_name}`: {_text(f.type)}" for f in kind.fields)
        case inspect.Metadata():
            return _text(kind.type)
    raise TypeError(f"{kind}: no words for this type of field")


def _range(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return ""
    if high is None or high == 2**63 - 1:
        return f", {low} or more"
    return f", {low} to {high}"


def _at_most(count: int | None) -> str:
    return "" if count is None else f", at most {count}"
