"""The benchmark of few steps of the decoder, on a tiny pipeline."""

import json

import decoder
import numpy as np
import pytest

from tactile_diffusers import LCTGModel, VDDIMScheduler


def test_measures_every_number_of_steps(checkpoint, prepared, tmp_path, capsys):
    own = LCTGModel.from_pretrained(checkpoint, subfolder="lctg")
    own.register_to_config(distilled_steps=2)
    own.save_pretrained(tmp_path / "run" / "lctg_distilled")
    VDDIMScheduler().save_pretrained(tmp_path / "run" / "scheduler")
    words = f"--checkpoint {checkpoint} --data {prepared} --quiet --output {tmp_path / 'out'}".split()
    assert decoder.main([*words, "--decoders", f"two={tmp_path / 'run'}"]) == 0
    rows = json.loads((tmp_path / "out" / "decoder.json").read_text())["rows"]
    assert [name for name in rows if name.startswith("two")] == ["two, 1 step", "two, 2 steps"]
    errors = {name: row["reconstructed: nine-band error, dB"] for name, row in rows.items()}
    # the same weights, and the first order of the checkpoint's own sampler
    assert errors["two, 2 steps"] == pytest.approx(errors["as trained, 2 steps"], rel=1e-4)
    assert errors["as trained, 1 step"] != pytest.approx(errors["as trained, 2 steps"], rel=1e-4)
    assert all(np.isfinite(row["generated: KTD over real"]) for row in rows.values())
    with pytest.raises(SystemExit):
        decoder.main([*words, "--decoders", "two"])
    assert "--decoders: must be NAME=FOLDER" in capsys.readouterr().err
