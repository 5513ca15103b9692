"""Who may import whom, and what importing the package may load."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
SOURCES = sorted((REPOSITORY / "fipt").rglob("*.py"))
WORKFLOW_FOLDER = REPOSITORY / "fipt" / "workflow"
WORKFLOW = sorted(
    path
    for path in [REPOSITORY / "Snakefile", *WORKFLOW_FOLDER.rglob("*")]
    if path.is_file() and path.suffix in ("", ".smk", ".py")
)
HEAVY = {
    "cv2", "drjit", "exifread", "fast_simplification", "imageio_ffmpeg", "lensfunpy", "matplotlib", "mitsuba",
    "numpy", "OpenEXR", "PIL", "pxr", "pycolmap", "pydantic", "pyoidn", "rawpy", "safetensors", "scipy",
    "snakemake", "torch", "transformers", "trimesh", "xatlas",
}  # fmt: skip


def imports(path: Path, at_import_only: bool = False) -> set[str]:
    """Top-level names of the packages that a file imports."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.Import):
            found.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
        if at_import_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            return
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(), str(path)))
    return found


def relative(paths: list[Path]) -> list[str]:
    """Paths for people."""
    return [str(path.relative_to(REPOSITORY)) for path in paths]


def test_there_is_something_to_look_at() -> None:
    assert len(SOURCES) > 5


def test_only_one_verb_knows_the_workflow_system() -> None:
    """``fipt run``, which is a front to it."""
    files = [
        path for path in (REPOSITORY / "fipt").rglob("*") if path.is_file() and WORKFLOW_FOLDER not in path.parents
    ]
    knows = [path for path in files if b"snakemake" in path.read_bytes().lower()]
    names = {name for name in relative(knows) if not name.endswith(".pyc")}
    assert names == {"fipt/cli/run.py", "fipt/cli/run_view.py"}


def test_the_workflow_computes_nothing() -> None:
    forbidden = ("numpy", "torch", "mitsuba", "drjit", "cv2", "scipy")
    guilty = [
        f"{path.relative_to(REPOSITORY)}: {line.strip()}"
        for path in WORKFLOW
        for line in path.read_text().splitlines()
        if line.lstrip().startswith(("import ", "from ")) and any(n in line for n in forbidden)
    ]
    assert guilty == []


def test_only_the_ray_layer_touches_mitsuba() -> None:
    layer = REPOSITORY / "fipt" / "render"
    others = [path for path in SOURCES if layer not in path.parents]
    assert relative([path for path in others if "mitsuba" in imports(path)]) == []


def test_no_module_chooses_the_variant_when_imported() -> None:
    guilty = []
    for path in SOURCES:
        for node in ast.walk(_outside_functions(ast.parse(path.read_text(), str(path)))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("set_variant"):
                guilty.append(path)
    assert relative(guilty) == []


def test_only_one_module_sets_mitsubas_variant() -> None:
    caller = REPOSITORY / "fipt" / "render" / "variant.py"
    for path in SOURCES:
        source = path.read_text()
        if path != caller:
            assert "mitsuba.set_variant(" not in source, path
            assert "mi.set_variant(" not in source or path.name == "doctor.py", path


def _outside_functions(tree: ast.Module) -> ast.Module:
    """A module without the bodies of its functions: what runs when it is imported."""

    class Cut(ast.NodeTransformer):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
            return None

        visit_AsyncFunctionDef = visit_FunctionDef

        def visit_Lambda(self, node: ast.Lambda) -> ast.AST:
            return ast.Constant(None)

    return Cut().visit(tree)


def test_verbs_load_nothing_heavy_when_imported() -> None:
    """So that usage errors and ``fipt VERB --help`` come at once."""
    verbs = sorted((REPOSITORY / "fipt" / "cli").glob("*.py"))
    guilty = {
        path.name: sorted(imports(path, at_import_only=True) & HEAVY)
        for path in verbs
        if imports(path, at_import_only=True) & HEAVY
    }
    assert guilty == {}


@pytest.mark.parametrize("module", ["fipt", "fipt.cli.main", "fipt.render.variant", "fipt.doctor"])
def test_importing_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*{{name.split('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) & HEAVY == set()


def test_what_asks_no_network_does_not_wait_for_torch() -> None:
    """Emitters by regions, and the copies of a round that has settled."""
    modules = "fipt.stages.emitters.extract, fipt.stages.fit.settling, fipt.scene.observed"
    code = f"import sys, {modules}; print('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_imports_go_one_way() -> None:
    lint_imports = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run([lint_imports, "--no-cache"], capture_output=True, text=True, cwd=REPOSITORY, check=False)
    assert run.returncode == 0, run.stdout
