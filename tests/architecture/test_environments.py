"""Every way to install fipt names the same packages: the project, its lock, conda and the image."""

import re
import tomllib
from pathlib import Path

import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

REPOSITORY = Path(__file__).resolve().parents[2]
CONDA = {"matplotlib-base": "matplotlib", "pytorch": "torch", "snakemake-minimal": "snakemake"}
"""Name of a package on conda-forge -> on PyPI, where they differ."""
OTHERS = {"python", "pip", "make", "libllvm19", "setuptools"}
"""What is no requirement of the project: the machine's, and what builds it."""


def locked() -> dict[str, str]:
    """Package -> version in requirements.lock."""
    lines = [line.split("#")[0].strip() for line in (REPOSITORY / "requirements.lock").read_text().splitlines()]
    return {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines if line)}


def of_conda(file: str) -> tuple[list[Requirement], list[str]]:
    """Requirements of a conda environment, and lines of its pip section that are none."""
    found, other = [], []
    for each in yaml.safe_load((REPOSITORY / file).read_text())["dependencies"]:
        for text in each["pip"] if isinstance(each, dict) else [each]:
            name = re.split(r"[ <>=]", text)[0]
            if text.startswith("-"):
                other.append(text)
            elif name not in OTHERS:
                found.append(Requirement(text.replace(name, CONDA.get(name, name), 1)))
    return found, other


def of_project() -> dict[str, Requirement]:
    """Requirements of pyproject.toml, those of its extras for all, by name."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    texts = [*project["dependencies"], *extras["geometry"], *extras["s3"], *extras["dev"]]
    return {canonicalize_name(each.name): each for each in map(Requirement, texts)}


def test_the_lock_holds_what_the_project_needs():
    versions = locked()
    for name, wanted in of_project().items():
        assert name in versions, name
        assert wanted.specifier.contains(versions[name], prereleases=True), (str(wanted), versions[name])


def test_conda_names_the_same_packages_and_admits_their_versions():
    versions, project = locked(), of_project()
    found, other = of_conda("environment.yml")
    assert other == []
    names = {canonicalize_name(each.name) for each in found}
    assert names == project.keys()
    for each in found:
        assert each.specifier.contains(versions[canonicalize_name(each.name)], prereleases=True), str(each)


def test_conda_and_the_image_take_the_lock():
    assert of_conda("environment.lock.yml") == ([], ["-r requirements.lock"])
    image = (REPOSITORY / "fipt.def").read_text()
    assert "pip install --no-cache-dir -r requirements.lock" in image
    makefile = (REPOSITORY / "Makefile").read_text()
    llvm = re.search(r"^LLVM_PACKAGES := (\w+)", makefile, re.MULTILINE)[1]
    for package in [llvm, *re.search(r"^OPEN3D_PACKAGES := (.*)$", makefile, re.MULTILINE)[1].split()]:
        assert package in image.split(), package
    assert llvm in (REPOSITORY / "environment.lock.yml").read_text()
