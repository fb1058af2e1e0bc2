"""What `help()` says: of each argument its type, and what comes back."""

from __future__ import annotations

import inspect
import re

import pytest

import nvsprior


def documented():
    """All functions, methods and properties of the package, by their names."""
    for name in nvsprior.__all__:
        value = getattr(nvsprior, name)
        if inspect.isclass(value):
            yield name, value
            for part, member in vars(value).items():
                if not part.startswith("_") and part != "encoder" and part != "link":
                    yield f"{name}.{part}", getattr(value, part)
        elif callable(value):
            yield name, value


DOCUMENTED = [(name, value) for name, value in documented() if "Error" not in name and not name.startswith("Shown")]


@pytest.mark.parametrize(("name", "value"), DOCUMENTED, ids=[name for name, _ in DOCUMENTED])
def test_types_are_told(name, value):
    text = " ".join((inspect.getdoc(value) or "").split())
    assert len(text) > 10, "it says nothing"
    if inspect.isclass(value):
        # Those that only calls make have none; classes of Python have annotations.
        found = "" if name == "Vehicle" else value.__text_signature__ or ""
        parameters = re.findall(r"\w+(?==|,|\))", re.sub(r"=[^,)]*", "=", found))
        assert found in ("", "(**fields)") or parameters
        assert all(f"{parameter}:" in text for parameter in parameters if parameter != "fields"), parameters
    elif inspect.isfunction(value):
        assert "Returns" in text
        signature = inspect.signature(value)
        assert all(p.annotation is not p.empty for p in signature.parameters.values() if p.name != "self")
    elif callable(value):
        assert "Returns" in text
        parameters = [parameter for parameter in inspect.signature(value).parameters if parameter != "self"]
        assert all(f"{parameter}:" in text for parameter in parameters), parameters
    else:
        assert "Type: " in text


def test_all_classes_are_looked_at():
    assert len(DOCUMENTED) > 150
