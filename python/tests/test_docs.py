"""The examples in docstrings are run; everything public has one, or is a field that its class explains."""

import doctest
import importlib
import importlib.util
import inspect
import re
from pathlib import Path

import pytest

import solidmap
from conftest import ROOT

FLAGS = {
    "NATIVE": solidmap.HAS_NATIVE,
    "PLOT": all(importlib.util.find_spec(name) for name in ("pyvista", "matplotlib")),
    "DASK": importlib.util.find_spec("distributed") is not None,
}
NUMBERS = {name: doctest.register_optionflag(name) for name in FLAGS}
MODULES = [
    "",
    ".boundary",
    ".shapes",
    ".plot",
    ".dask",
    "._applications",
    "._fields",
    "._fit",
    "._map",
    "._meshes",
    "._polycube",
]


def examples():
    finder = doctest.DocTestFinder(exclude_empty=True)
    for name in MODULES:
        module = importlib.import_module("solidmap" + name)
        for test in finder.find(module, module.__name__):
            if test.examples:
                yield test
    parser = doctest.DocTestParser()
    for page in (ROOT / "docs" / "python.md", ROOT / "README.md"):
        for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)):
            if ">>>" in block:
                yield parser.get_doctest(block, {}, f"{page.name}[{number}]", str(page), 0)


@pytest.mark.parametrize("test", list(examples()), ids=lambda test: test.name)
def test_example(test, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for example in test.examples:
        lacking = [name for name, number in NUMBERS.items() if example.options.get(number) and not FLAGS[name]]
        if lacking:
            example.options[doctest.SKIP] = True
    output = []
    failed, _ = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=output.append)
    assert not failed, "".join(output)


def public():
    for name in solidmap.__all__:
        value = getattr(solidmap, name)
        if inspect.isfunction(value):
            yield name, value
        if inspect.isclass(value) and value.__module__.startswith("solidmap"):
            yield name, value


@pytest.mark.parametrize("name, value", list(public()), ids=lambda value: value if isinstance(value, str) else "")
def test_everything_public_has_a_docstring(name, value):
    assert inspect.getdoc(value)
    if inspect.isfunction(value) and value.__module__.startswith("solidmap"):
        assert ">>>" in value.__doc__, f"{name} has no example"
        parameters = inspect.signature(value).parameters
        unexplained = [p for p in parameters if p not in value.__doc__]
        assert not unexplained, f"{name} does not explain {unexplained}"


def test_the_page_names_every_function():
    page = (Path(ROOT) / "docs" / "python.md").read_text()
    functions = [name for name in solidmap.__all__ if inspect.isfunction(getattr(solidmap, name))]
    assert [name for name in functions if name not in page] == []
