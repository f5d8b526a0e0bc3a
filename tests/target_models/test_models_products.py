"""What make-target can write beside paper: named, light until made, and quick."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from boxcal.target.box import Box, make_target
from boxcal.target.models import products as models
from boxcal.target.models.products import EXTRAS, Product, missing_modules, products

SMALL = Box(width=0.131, depth=0.152, height=0.0937, columns=3, rows=2, tag_size=0.0301, pitch=0.0367, first_id=40)
HEAVY = {"numpy", "cv2", "cadquery", "OCP", "ezdxf", "manifold3d", "vtk"}


def by_name(name: str) -> Product:
    (found,) = [p for p in products(dpi=60) if p.name == name]
    return found


@pytest.mark.parametrize("product", products(dpi=60), ids=lambda p: p.name)
def test_products_keep_to_their_name_and_repeat_to_the_byte(product: Product) -> None:
    if missing := missing_modules(product):
        pytest.skip(f"not installed: {', '.join(missing)}")
    target = make_target(SMALL)
    files = product.make(target)
    assert files
    assert all(name == product.name or name.startswith(product.name + "/") for name in files)
    assert all(".." not in Path(name).parts and not Path(name).is_absolute() for name in files)
    assert all(files.values())
    assert dict(product.make(target)) == dict(files)


def test_naming_products_loads_nothing_heavy() -> None:
    code = (
        "import sys\nfrom boxcal.target.models.products import missing_modules, products\n"
        "lines = [(p.name, p.what, missing_modules(p)) for p in products()]\n"
        f"assert len(lines) > 5 and not {HEAVY!r} & set(sys.modules), {HEAVY!r} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_products_without_the_extra_load_none_of_it() -> None:
    extra = {"cadquery", "OCP", "ezdxf", "manifold3d", "vtk"}
    code = (
        "import sys\nfrom boxcal.target.box import make_target\nfrom boxcal.target.models.products import products\n"
        "for p in products(dpi=30):\n    if not p.extra:\n        assert p.make(make_target())\n"
        f"assert not {extra!r} & set(sys.modules), {extra!r} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_modules_that_are_not_installed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "EXTRAS", {"cad": ("math", "no_such_kernel")})
    assert missing_modules(by_name("cad")) == ("no_such_kernel",)
    assert missing_modules(by_name("obj")) == ()


def test_every_extra_is_known() -> None:
    assert {p.extra for p in products()} == {"", *EXTRAS}


@pytest.mark.slow
def test_every_product_of_the_default_box_is_made_in_a_fresh_process() -> None:
    """The whole default box with everything that the extra gives, imports included."""
    if any(find_spec(name) is None for name in EXTRAS["cad"]):
        pytest.skip("the extra 'cad' is not installed")
    code = (
        "from boxcal.target.box import make_target\nfrom boxcal.target.models.products import products\n"
        "names = [n for p in products() for n in p.make(make_target())]\n"
        "assert {n.rsplit('.')[-1] for n in names} >= {'step', 'stl', 'dxf', 'glb', 'sdf', '3mf', 'png', 'xml'}\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
