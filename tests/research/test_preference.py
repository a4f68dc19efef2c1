"""Simulated people of known taste, a few of them."""

import numpy as np
import preference


def test_people_are_simulated_and_a_page_is_written(make_pipeline, rating_statistics, tmp_path, monkeypatch, capsys):
    config = {"scalar_width": 16, "distilled_steps": 1, "rating_statistics": rating_statistics}
    make_pipeline(dale_config=config).save_pretrained(str(tmp_path / "pipeline"))
    monkeypatch.setattr(preference, "ASKED", (1, 10, 25))
    monkeypatch.setattr(preference, "felt_by_estimator", lambda search: lambda points: 0.5 * points)
    out = tmp_path / "out"
    words = f"--output {out} --people 3 --listeners 2 --checkpoint {tmp_path / 'pipeline'}"
    assert preference.main(words.split()) == 0
    text = (out / "preference.md").read_text()
    assert text.count("| preference search |") == 3 and text.count("| sliders on a grid |") == 2
    assert (out / "preference.png").stat().st_size > 10_000


def test_the_median_counts_from_where_it_stays_met():
    hits = np.zeros((3, len(preference.ASKED)), dtype=bool)
    hits[0, 2:], hits[1, 4:], hits[2, 0] = True, True, True  # the third one is met once, and lost again
    assert preference._median_until(hits) == preference.ASKED[4]
    assert preference._median_until(hits[2:]) is None
