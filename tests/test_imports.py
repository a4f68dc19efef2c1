"""What is imported without being used would cost its users seconds: each in a fresh process."""

import subprocess
import sys

import pytest

_CODE = "import importlib, sys; importlib.import_module({!r}); print(*sys.modules.keys() & {{'torch', 'diffusers'}})"


@pytest.mark.parametrize("name", ["playback", "export", "display", "data", "cli.play", "cli.generate"])
def test_no_models_are_imported_for(name):
    done = subprocess.run([sys.executable, "-c", _CODE.format(f"tactile_diffusers.{name}")], capture_output=True)
    assert done.returncode == 0 and done.stdout.split() == [], done


def test_every_public_name_is_there():
    import tactile_diffusers
    from tactile_diffusers import pipelines, playback

    for module in (tactile_diffusers, pipelines, playback):
        assert all(getattr(module, name) is not None for name in module.__all__)
        assert set(tactile_diffusers.__all__) <= set(dir(tactile_diffusers))
        with pytest.raises(AttributeError, match="has no attribute 'texture'"):
            _ = module.texture
