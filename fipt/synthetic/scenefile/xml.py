"""The tree of a Mitsuba scene file (versions 0.5 to 3): defaults filled in, includes read, references resolved.

Names of properties become snake_case, so that ``toWorld`` and ``to_world`` are one. Document types and entities are
refused: they can make a small file huge or read other files.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

from fipt.errors import FiptError
from fipt.formats.files import existing_file

_MOST_FILES = 100
"""Scene files that are read for one."""
_DEEPEST = 40
"""Elements within elements; scene files have about six."""
_LARGEST = 2_000_000
"""Elements of a file whose references are filled in: references to references can double it again and again."""


_OBJECTS = "shape bsdf emitter texture spectrum sensor film rfilter sampler integrator medium phase volume subsurface"
"""Elements with a plugin's type; the properties in them have names."""
_PROPERTIES = "float integer boolean string point vector rgb srgb color blackbody spectrum transform animation"
_OTHERS = "scene matrix translate scale rotate lookat ref alias default include path null"
"""Elements that mean something elsewhere."""


@dataclass(frozen=True)
class Node:
    """An element: an object with a plugin's type, or a property.

    Attributes
    ----------
    tag
        ``shape``, ``bsdf``, ``rgb``, ``float``, ...
    attributes
        As in the file, defaults filled in; ``name`` in snake_case.
    children
        Elements inside, in order; references replaced by what they refer to.
    where
        File and line, for errors.
    size
        Number of elements, this one included.
    """

    tag: str
    attributes: dict[str, str]
    children: tuple[Node, ...]
    where: str = field(compare=False, repr=False)
    size: int = field(default=1, compare=False, repr=False)

    @property
    def type(self) -> str:
        """The plugin's name."""
        return self.attributes.get("type", "")

    @property
    def name(self) -> str:
        """The property's name in snake_case, or nothing."""
        return self.attributes.get("name", "")

    @property
    def id(self) -> str:
        """What references call it, or nothing."""
        return self.attributes.get("id", "")

    def get(self, *names: str) -> Node | None:
        """Return the property of the first of these names that is there."""
        for name in names:
            for child in self.children:
                if child.name == name:
                    return child
        return None

    def objects(self, tag: str) -> list[Node]:
        """Return the children with a tag, in order."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> Iterator[Node]:
        """Yield the element and all within it."""
        yield self
        for child in self.children:
            yield from child.walk()

    def text(self, name: str, default: str = "") -> str:
        """Return a string property."""
        found = self.get(name)
        return default if found is None else found.attributes.get("value", default)

    def flag(self, name: str, default: bool) -> bool:
        """Return a boolean property."""
        text = self.text(name, str(default)).strip().lower()
        if text not in ("true", "false"):
            raise self.wrong(f"{name} must be true or false; found {text!r}")
        return text == "true"

    def number(self, name: str, default: float) -> float:
        """Return a number; where the property is something else (a texture, a preset's name) raise an error."""
        found = self.get(name)
        return default if found is None else found.as_number()

    def as_number(self) -> float:
        """Return the value of a number property."""
        text = self.attributes.get("value", "")
        try:
            if math.isfinite(number := float(text)):
                return number
            raise ValueError("it is not finite")
        except ValueError as error:
            raise self.wrong(f"{self.name or self.tag} must be a number; found {text!r}") from error

    def wrong(self, message: str) -> FiptError:
        """Return an error that names the place."""
        return FiptError(f"{self.where}: {message}", "repair the scene file")


@dataclass
class SceneTree:
    """A whole scene file.

    Attributes
    ----------
    root
        The ``scene`` element; its children include those of included files.
    files
        The XML files that were read.
    """

    root: Node
    files: list[Path] = field(default_factory=list)


def read_tree(path: str | Path) -> SceneTree:
    """Read a scene file.

    Raises
    ------
    FiptError
        If it is missing, not XML, not a Mitsuba scene, has a document type, refers to an id that is not there, or
        includes a file outside its folder.
    """
    path = existing_file(path, "the scene file")
    reader = _XmlReader(path.parent)
    root = reader.read(path)
    return SceneTree(reader.resolved(root, ()), reader.files)


def scene_files(path: str | Path) -> list[Path]:
    """List the scene file and all files that are there of those it names; loads none of them.

    Raises
    ------
    FiptError
        If the scene file is missing or cannot be read.
    """
    path = Path(path)
    tree = read_tree(path)
    names = []
    for part in ("shape", "bsdf", "emitter", "texture"):
        for node in tree.root.objects(part):
            names += [found.attributes.get("value", "") for found in node.walk() if found.name == "filename"]
    named = (inside(path.parent, name) for name in dict.fromkeys(names) if name)
    return tree.files + [file for file in named if file is not None and file.is_file()]


def inside(folder: Path, text: str) -> Path | None:
    """Return the file that ``text`` names below ``folder``, links followed; None where it lies outside."""
    path = folder / text.replace("\\", "/")
    return path if path.resolve().is_relative_to(folder.resolve()) else None


class _XmlReader:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files: list[Path] = []
        self.defaults: dict[str, str] = {}
        self.ids: dict[str, Node] = {}
        self.twice: set[str] = set()
        self.done: dict[tuple[str, str | None], Node] = {}

    def read(self, path: Path) -> Node:
        if path in self.files:
            raise FiptError(f"{path} is included twice, or includes itself", "include each file once")
        if len(self.files) >= _MOST_FILES:
            raise FiptError(f"{self.files[0]} includes more than {_MOST_FILES} files", "include fewer, larger files")
        self.files.append(path)
        parser = expat.ParserCreate()
        stack: list[tuple[str, dict[str, str], list[Node], str]] = [("", {}, [], "")]

        def start(tag: str, attributes: dict[str, str]) -> None:
            if len(stack) > _DEEPEST:
                raise FiptError(f"{path}: elements are nested more than {_DEEPEST} deep", "flatten the scene file")
            filled = {key: self._filled(value) for key, value in attributes.items()}
            if "name" in filled and tag != "default":
                filled["name"] = snake(filled["name"])
            if len(stack) == 1:
                _check_scene(tag, filled, path)
            stack.append((tag, filled, [], f"{path.name} line {parser.CurrentLineNumber}"))

        def end(tag: str) -> None:
            _, attributes, children, where = stack.pop()
            siblings = stack[-1][2]
            if tag == "default":
                self.defaults.setdefault(attributes.get("name", ""), attributes.get("value", ""))
            elif tag == "alias":
                self.ids[attributes.get("as", "")] = Node("ref", {"id": attributes.get("id", "")}, (), where)
            elif tag == "include":
                siblings.extend(self._included(attributes.get("filename", ""), where))
            else:
                node = Node(tag, attributes, tuple(children), where)
                if siblings is not stack[0][2]:
                    _check(node, path.parent)
                siblings.append(node)
                if node.id and tag != "ref":
                    if node.id in self.ids:
                        self.twice.add(node.id)
                    self.ids[node.id] = node

        def doctype(*_: object) -> None:
            raise FiptError(f"{path} has a document type (DTD), which is refused", "remove the <!DOCTYPE ...> line")

        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.StartDoctypeDeclHandler = doctype
        try:
            parser.Parse(path.read_bytes(), True)
        except (expat.ExpatError, LookupError, ValueError) as error:  # the latter two: unknown encodings
            raise FiptError(f"{path} is not well-formed XML ({error})", "repair the scene file") from error
        (root,) = stack[0][2]
        return root

    def _filled(self, text: str) -> str:
        """Fill in defaults; a parameter without one stays as it is, since what it sets may never be asked for."""
        return re.sub(r"\$(\w+)", lambda found: self.defaults.get(found[1], found[0]), text)

    def _included(self, name: str, where: str) -> tuple[Node, ...]:
        file = inside(self.folder, name)
        if file is None:
            raise FiptError(f"{where} includes {name}, outside the scene's folder", "move the file into the folder")
        return self.read(existing_file(file, f"the file that {where} includes")).children

    def resolved(self, node: Node, above: tuple[str, ...]) -> Node:
        """Replace references inside a node."""
        if node.tag == "ref":
            wanted = node.attributes.get("id", "")
            if wanted not in self.ids:
                raise node.wrong(f"nothing has the id {wanted!r}")
            if wanted in self.twice:
                raise node.wrong(f"the id {wanted!r} is there twice")
            if wanted in above:
                raise node.wrong(f"{wanted!r} refers to itself")
            # The same object for all who refer to it by the same name: materials are told apart by identity.
            key = (wanted, node.attributes.get("name"))
            if key not in self.done:
                target = self.resolved(self.ids[wanted], (*above, wanted))
                attributes = {name: value for name, value in target.attributes.items() if name != "name"}
                attributes |= {} if key[1] is None else {"name": key[1]}
                self.done[key] = replace(target, attributes=attributes)
            return self.done[key]
        children = tuple(self.resolved(child, above) for child in node.children)
        size = 1 + sum(child.size for child in children)
        if size > _LARGEST:
            raise node.wrong(f"references make more than {_LARGEST} elements of it")
        return replace(node, children=children, size=size)


def snake(name: str) -> str:
    """Turn camelCase (``diffuseReflectance``, ``intIOR``) into snake_case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _check_scene(tag: str, attributes: dict[str, str], path: Path) -> None:
    """Refuse a first element that is no scene, or one of a version with other elements."""
    if tag != "scene":
        raise FiptError(
            f"{path} is no Mitsuba scene: its first element is <{tag}>, not <scene>", "give a Mitsuba XML file"
        )
    version = attributes.get("version", "")
    if not re.fullmatch(r"(0\.[5-9]|[1-3](\.\d+)?)(\.\d+)?", version):
        raise FiptError(
            f"{path}: the version of a scene file must be that of Mitsuba, 0.5 to 3; found {version!r}",
            'correct version="..." of its first element: angles and axes of skies depend on it',
        )


def _check(node: Node, folder: Path) -> None:
    """Refuse what Mitsuba refuses, and readers would leave out or guess: odd elements, properties without a name."""

    def wrong(at: Node, message: str) -> FiptError:
        return FiptError(f"{folder / at.where}: {message}", "repair the scene file")

    objects, properties = _OBJECTS.split(), _PROPERTIES.split()
    if node.tag.lower() not in (*objects, *properties, *_OTHERS.split()):
        raise wrong(node, f"scene files have no element <{node.tag}>")
    if node.tag not in objects:
        return
    named: dict[str, Node] = {}
    for child in node.children:
        if child.tag in properties and not child.name:
            raise wrong(child, f"a <{child.tag}> in a <{node.tag}> must have a name")
        if child.tag in properties and named.setdefault(child.name, child) != child:
            raise wrong(child, f"{child.name} is stated twice, with two values")
