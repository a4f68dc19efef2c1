"""The benchmark of few steps of the decoder, on a tiny pipeline."""

import json

import decoder
import numpy as np
import pytest

from tactile_diffusers import LCTGModel, TactileTexturePipeline


def test_measures_every_number_of_steps(checkpoint, prepared, tmp_path):
    own = LCTGModel.from_pretrained(checkpoint, subfolder="lctg")
    own.register_to_config(distilled_steps=2)
    TactileTexturePipeline.from_pretrained(checkpoint, lctg_distilled=own).save_pretrained(tmp_path / "both")
    words = f"--checkpoint {tmp_path / 'both'} --data {prepared} --few --quiet --output {tmp_path / 'out'}".split()
    assert decoder.main(words) == 0
    rows = json.loads((tmp_path / "out" / "decoder.json").read_text())["rows"]
    assert [name for name in rows if name.startswith("distilled")] == ["distilled, 1 step", "distilled, 2 steps"]
    errors = {name: row["reconstructed: nine-band error, dB"]["mean"] for name, row in rows.items()}
    # the same weights and sampler
    assert errors["distilled, 2 steps"] == pytest.approx(errors["as trained, 2 steps"], rel=1e-6)
    assert errors["as trained, 1 step"] != pytest.approx(errors["as trained, 2 steps"], rel=1e-4)
    assert all(np.isfinite(row["generated: KTD over real"]["mean"]) for row in rows.values())
