"""Adapting a pipeline: recalibration in closed form, what it leaves alone, the whole of `adapt` on tiny data."""

import copy
import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.cli import adapt as command
from tactile_diffusers.data.dataset import PreparedDataset, check_fit
from tactile_diffusers.models.calibration import own_calibration, products, scalar_shift
from tactile_diffusers.training import adapting, further_training, recalibration
from tactile_diffusers.training.adapting import Errors, adapt, adaptation_parser, trains_decoder
from tactile_diffusers.training.further_training import DecoderFit
from tactile_diffusers.training.loop import Trainer
from tactile_diffusers.training.recalibration import (
    Recalibration,
    Surfaces,
    explain,
    generate_surfaces,
    generate_trusting,
    recalibrate,
)

SHORT = {"train_batch_size": 4, "lr_warmup_steps": 1, "checkpointing_steps": 2, "validation_steps": 2}
SHORT |= {"max_train_steps": 4, "quiet": True}


@pytest.fixture
def dale(make_dale):
    """Three bands, two envelope channels, three learned ones, and 22 scalars."""
    bands = {"level_channels": 3, "envelope_channels": 2, "latent_mean": [0.0] * 6, "latent_std": [1.0] * 6}
    return make_dale(in_channels=30, latent_frames=16, patch_size=2, departure_std=[1.0] * 3, **bands)


@pytest.fixture
def lab(dale):
    """`lab(count, takes, change=function of scalars and ratings)`: surfaces whose scalars follow their ratings."""

    def make(count=40, takes=8, seed=0, change=lambda scalars, ratings: scalars):
        ratings = np.random.default_rng(count).normal(size=(count, 3))
        rng, size = np.random.default_rng(seed), dale.num_scalars
        mapping = np.random.default_rng(7).normal(size=(3, size)) * 0.4
        owners = np.repeat(np.arange(count), takes)
        scalars = ratings[owners] @ mapping + rng.normal(size=(count * takes, size))
        scalars = change(scalars, ratings[owners])
        field = torch.from_numpy(rng.normal(size=(len(owners), dale.config.in_channels - size, 16)))
        states = dale.append_scalars(field, torch.from_numpy(scalars)).float()
        return Surfaces(states, owners, ratings, np.ones(len(owners), bool))

    return make


class TestExplanation:
    def test_no_difference_is_no_shift(self):
        inputs = np.random.default_rng(0).normal(size=(10, 3))
        assert not any(part.any() for part in explain(np.zeros((10, 4)), inputs, inputs, np.ones(4)))

    def test_noise_moves_far_less_than_its_mean(self):
        rng = np.random.default_rng(0)
        noise = rng.normal(size=(3, 20))
        offset = explain(noise, rng.normal(size=(3, 3)), rng.normal(size=(3, 6)), np.ones(20))[0]
        # three surfaces of the pretrained world: their mean is off by 1 / sqrt(3)
        assert np.abs(offset).mean() < 0.5 * np.abs(noise.mean(0)).mean()

    def test_a_large_shift_is_found_by_few_surfaces(self):
        rng = np.random.default_rng(0)
        differences = 3.0 + 0.5 * rng.normal(size=(5, 20))
        offset = explain(differences, rng.normal(size=(5, 3)), np.zeros((5, 0)), np.ones(20))[0]
        assert offset.mean() == pytest.approx(3.0, abs=0.3)  # 0.5 / sqrt(5 x 20), and what slopes take

    def test_slopes_and_curves_are_found_by_many(self):
        rng = np.random.default_rng(0)
        inputs, slopes, curves = rng.normal(size=(200, 3)), rng.normal(size=(3, 5)), 0.3 * rng.normal(size=(6, 5))
        pairs = products(torch.from_numpy(inputs)).numpy()
        differences = 1.0 + inputs @ slopes + pairs @ curves + 0.5 * rng.normal(size=(200, 5))
        found = explain(differences, inputs, pairs, np.ones(5))
        assert np.allclose(found[1], slopes, atol=0.15)  # four standard errors of 0.5 / sqrt(200)
        assert np.allclose(found[2], curves, atol=0.15)

    def test_what_is_left_of_each_surface_is_as_if_it_had_been_left_out(self, monkeypatch):
        monkeypatch.setattr(recalibration, "OFFSETS", (0.8,))  # else the others change the weights of the priors
        monkeypatch.setattr(recalibration, "SLOPES", (0.4,))
        monkeypatch.setattr(recalibration, "RESIDUALS", np.array([1.0]))
        rng = np.random.default_rng(0)
        inputs, differences, none, unit = rng.normal(size=(7, 3)), rng.normal(size=(7, 2)), np.zeros((7, 0)), np.ones(2)
        offset, slopes, _, _ = explain(differences[1:], inputs[1:], none[1:], unit)
        left = explain(differences, inputs, none, unit)[3][0]
        assert np.allclose(left, differences[0] - offset - inputs[0] @ slopes, atol=1e-9)  # float64


class TestRecalibration:
    def test_the_same_world_stays(self, dale, lab):
        change = recalibrate(dale, lab(seed=1), {1.0: lab(seed=2)})
        ratings = np.zeros((1, 3))
        moved = change.moved(np.zeros((1, dale.num_scalars)), ratings)
        assert np.abs(moved).max() < 0.15 and np.abs(change.slopes).max() < 0.15  # noise of 8 takes of 40 surfaces
        assert change.trust == 1 and not change.words()
        # the spread of 320 numbers that are drawn in 40 groups is known within 4 %, here at four times that
        assert np.allclose(change.factor, 1, atol=0.16) and np.allclose(change.shapes[1], 1, atol=0.05)

    def test_a_shifted_world_is_recovered(self, dale, lab):
        shift = np.linspace(-1, 1, dale.num_scalars)
        real = lab(seed=1, change=lambda scalars, ratings: scalars * 1.3 + shift + 0.5 * ratings[:, :1])
        change = recalibrate(dale, real, {1.0: (generated := lab(seed=2))})
        made = dale.split_scalars(generated.states)[1].double().numpy()
        moved = generated.mean(change.moved(made, generated.ratings[generated.owners]))
        wanted = real.mean(dale.split_scalars(real.states)[1].double().numpy())
        assert np.abs(moved - wanted).mean() < 0.6  # noise of eight takes of both, 0.56 in the mean of absolute values
        assert change.factor.mean() == pytest.approx(1.3, abs=0.1)

    def test_unknown_friction_is_untouched(self, dale, lab):
        real = lab(seed=1, change=lambda scalars, _: scalars + 2.0)
        real.knows_friction[:] = False
        change = recalibrate(dale, real, {1.0: lab(seed=2)})
        assert change.offset[-1] == 0 and not change.slopes[:, -1].any() and change.factor[-1] == 1
        assert change.offset[-2] == pytest.approx(2.0, abs=0.3)

    @pytest.mark.parametrize("unrated", [[1], [0, 1, 2]])
    def test_sliders_that_nobody_rated_stay(self, dale, lab, unrated):
        real = lab(seed=1, change=lambda scalars, ratings: scalars + 2.0 + ratings[:, 1:2])
        real.ratings[:, unrated] = np.nan
        change = recalibrate(dale, real, {1.0: lab(seed=2)})
        assert not change.slopes[unrated].any() and change.offset.mean() > 1.5

    def test_a_rating_left_out_changes_little(self, dale, lab):
        change, real = recalibrate(dale, lab(seed=1), {1.0: lab(seed=2)}), lab(seed=1)
        real.ratings[3, 1] = np.nan
        holes = recalibrate(dale, real, {1.0: lab(seed=2)})
        assert np.isfinite(holes.slopes).all() and np.abs(holes.offset - change.offset).max() < 0.1


def _change(dale, rng, axes=3):
    size, bands = dale.num_scalars, dale.config.level_channels
    learned = dale.latent_channels - bands - dale.config.envelope_channels
    shapes = np.zeros(learned), np.ones(learned), np.ones(bands)
    offset, slopes, factor = rng.normal(size=size), rng.normal(size=(axes, size)), np.exp(0.1 * rng.normal(size=size))
    curves = 0.3 * rng.normal(size=(axes * (axes + 1) // 2, size))
    ratings = np.array([0.5, 0.0, 0.0]), np.eye(axes) + 0.3, axes
    return Recalibration(1.0, offset, slopes, curves, factor, *ratings, shapes)


class TestTrust:
    """The networks see a share of the ratings."""

    def test_less_of_a_mapping_that_is_wrong(self, dale, lab):
        """A world that follows its ratings the other way round, in waves: no slope on top can mend that."""
        own = np.random.default_rng(7).normal(size=(3, dale.num_scalars)) * 0.4  # as `lab` has it

        def waves(share):
            return lambda scalars, ratings: scalars - ratings @ own + 3 * np.sin(4 * share * ratings[:, :1])

        real = lab(seed=1, change=lambda scalars, ratings: scalars - ratings @ own)
        generated = {share: lab(seed=2, change=waves(share)) for share in recalibration.TRUSTS}
        generated[0.25] = lab(seed=2, change=lambda scalars, ratings: scalars - 0.75 * ratings @ own)
        change = recalibrate(dale, real, generated)
        assert change.trust == 0.25 and "networks see 25%" in change.words()

    def test_no_less_than_surfaces_left_out_clearly_ask_for(self, dale, lab):
        real = lab(count=5, seed=1, change=lambda scalars, ratings: scalars + 3.0)
        change = recalibrate(dale, real, {trust: lab(count=5, seed=2) for trust in recalibration.TRUSTS})
        assert change.trust == 1  # all shares do as well: the pretrained mapping stays

    def test_the_networks_see_the_share_and_the_shift_all(self, pipe):
        ratings, dale = np.array([[0.5, -0.3, 1.0], [1.0, 0.2, -0.4]]), pipe.dale
        change = replace(_change(dale, np.random.default_rng(0)), trust=0.5)
        given = dict(dale.config)
        halves = generate_surfaces(dale, pipe.dale_scheduler, 0.5 * ratings, 3, 2).states
        trusting = generate_trusting(dale, pipe.dale_scheduler, ratings, 3, 2)
        assert dict(dale.config) == given and list(trusting) == list(recalibration.TRUSTS)
        assert torch.allclose(trusting[0.5].states, halves, atol=1e-5)  # float32
        wanted = change.moved(dale.split_scalars(halves)[1].double().numpy(), np.repeat(ratings, 3, axis=0))[:, -2]
        wanted = wanted * dale.config.level_std + dale.config.level_mean
        change.apply(dale)
        level = dale.unpack(generate_surfaces(dale, pipe.dale_scheduler, ratings, 3, 2).states)[1]
        assert np.allclose(level, wanted, atol=1e-4)
        change.apply(dale)  # once more: the networks see half of the half
        assert dale.config.calibration["trust"] == 0.25


class TestCalibratedModel:
    @pytest.mark.parametrize("steps", [1, 2, 7])
    def test_textures_move_as_said_in_any_number_of_steps(self, pipe, steps):
        ratings, dale = np.array([[0.5, -0.3, 1.0], [1.0, 0.2, -0.4]]), pipe.dale
        change = _change(dale, np.random.default_rng(0))
        before = generate_surfaces(dale, pipe.dale_scheduler, ratings, 3, steps).states
        scalars = dale.split_scalars(before)[1].double().numpy()
        wanted = change.moved(scalars, np.repeat(ratings, 3, axis=0))
        level = wanted[:, -2] * dale.config.level_std + dale.config.level_mean
        friction = wanted[:, -1] * dale.config.log_friction_std + dale.config.log_friction_mean
        change.apply(dale)
        _, found_level, found = dale.unpack(generate_surfaces(dale, pipe.dale_scheduler, ratings, 3, steps).states)
        assert np.allclose(found_level, level, atol=1e-4) and np.allclose(found.log(), friction, atol=1e-4)

    def test_open_axes_count_as_expected_given_the_others(self, dale):
        change = _change(dale, np.random.default_rng(0))
        change.apply(dale)
        nan = float("nan")
        found = scalar_shift(dale.config, torch.tensor([[1.0, nan, nan], [nan, nan, nan]]))
        share = 0.3 / 1.3  # of what the known axis is above its mean
        expected = np.array([[1.0, share * 0.5, share * 0.5], [0.5, 0.0, 0.0]])
        curved = products(torch.from_numpy(expected)).numpy() @ change.curves
        assert np.allclose(found, (change.offset + expected @ change.slopes + curved) / change.factor, atol=1e-5)

    def test_it_is_saved_and_loaded(self, pipe, tmp_path):
        _change(pipe.dale, np.random.default_rng(0)).apply(pipe.dale)
        pipe.save_pretrained(tmp_path / "p")
        loaded = TactileTexturePipeline.from_pretrained(str(tmp_path / "p"))
        loaded.set_progress_bar_config(disable=True)
        ours, theirs = (p([[0.5, None, 0]], generator=torch.Generator().manual_seed(0)) for p in (pipe, loaded))
        # weights that lie elsewhere in memory are multiplied in another order: 1e-5 of the textures' RMS
        assert np.allclose(ours.textures, theirs.textures, rtol=0, atol=2e-8)

    def test_refusals(self, make_dale):
        dale = make_dale()
        with pytest.raises(ValueError, match="`calibration` must hold"):
            make_dale(calibration={"offset": [0.0] * 2})
        wrong = {"offset": [0.0], "slopes": [[0.0, 0.0]] * 3, "centre": [0.0] * 3, "covariance": [[1.0] * 3] * 3}
        with pytest.raises(ValueError, match="`offset` must be finite numbers of shape"):
            make_dale(calibration=wrong)
        right = own_calibration(dale.config, dale.num_scalars)
        with pytest.raises(ValueError, match="`curves` must be finite numbers of shape"):
            make_dale(calibration=right | {"curves": right["curves"][:5]})
        with pytest.raises(ValueError, match="`calibration` must hold"):
            make_dale(calibration=right | {"further": 0.0})

    def test_a_calibration_without_curves_and_trust_is_read(self, make_dale):
        """As the first version wrote it."""
        dale = make_dale()
        right = own_calibration(dale.config, dale.num_scalars)
        first = {name: right[name] for name in ("offset", "slopes", "centre", "covariance")}
        assert not scalar_shift(make_dale(calibration=first).config, torch.ones(1, 3)).any()


class TestWords:
    def test_few_surfaces_say_little(self):
        errors = Errors(np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.0, 1.0]))
        assert "on 2 of 3 surfaces left out" in errors.against("It") and "too few to say more" in errors.against("It")
        worse = Errors(errors.given + 0.1, errors.own).against("It")
        assert "worse than the given checkpoint on 2 of 3" in worse

    @pytest.mark.parametrize(("gain", "word"), [(1.0, "by 1.00 dB"), (-1.0, "it is worse"), (0.0, "no difference")])
    def test_many_say_whether_it_can_be_told(self, gain, word):
        given = 5 + np.random.default_rng(0).normal(size=30)
        own = given - gain + 0.1 * np.tile([1.0, -1.0], 15)
        assert word in Errors(own, given).against("It")


@pytest.fixture
def dataset(prepared):
    """Four tiny surfaces."""
    return PreparedDataset(prepared, "train", "filtered", 2500)


@pytest.fixture
def distilled_pipe(make_pipeline, monkeypatch):
    """`distilled_pipe()`: a tiny pipeline with a decoder of one step; the four surfaces are enough to train it."""
    for module in (further_training, adapting):
        monkeypatch.setattr(module, "LEAST_SURFACES", 4)

    def make():
        pipe = make_pipeline()
        student = copy.deepcopy(pipe.lctg)
        student.register_to_config(distilled_steps=1)
        return TactileTexturePipeline.from_pipe(pipe, lctg_distilled=student)

    return make


def _weights(model):
    return {name: value.clone() for name, value in model.state_dict().items()}


def _differ(ours, theirs):
    return any(not torch.equal(ours[name], theirs[name]) for name in ours)


class TestAdapting:
    def test_recalibrated(self, make_pipeline, dataset, tmp_path, capsys):
        results = [adapt(make_pipeline(), dataset, tmp_path / name) for name in "ab"]
        (pipe, verdict), (again, _) = results
        assert dict(pipe.dale.config) == dict(again.dale.config) and pipe.dale.config.calibration
        assert "too few to say more" in verdict and "The decoder stays as it is" in verdict
        printed = capsys.readouterr().out
        assert printed.index("As it is, the given checkpoint") < printed.index("Recalibrated, it")
        card = (tmp_path / "a" / "README.md").read_text()
        assert "From their base layer the decoder (LCTG) gives nine bands back within" in card
        assert verdict in card and "base_model:" in card and dataset.surfaces[dataset.surface_ids[0]] in card
        record = json.loads((tmp_path / "a" / "training.json").read_text())
        assert record["steps"] == 0 and len(record["trained_on"]["surfaces"]) == 4

    def test_two_surfaces_on_the_device_and_back(self, make_pipeline, prepared, tmp_path, monkeypatch):
        two, moved = PreparedDataset(prepared, "train", "filtered", 2500, max_surfaces=2), []
        pipe = make_pipeline()
        monkeypatch.setattr(TactileTexturePipeline, "to", lambda self, device: moved.append(device))
        pipe, verdict = adapt(pipe, two, tmp_path / "out")
        assert "of 2 surfaces left out" in verdict and np.isfinite(pipe.dale.config.calibration["offset"]).all()
        assert moved == [torch.device("cpu")] * 2

    def test_a_new_run_without_decoder_clears_the_old_one_and_records_its_own_updates(
        self, distilled_pipe, dataset, tmp_path, monkeypatch
    ):
        words = ["--train_data_dir", str(dataset.path), "--output_dir", str(tmp_path), "--overwrite_output_dir"]
        args = adaptation_parser("").parse_args(words)
        given = dict(vars(args))
        adapt(distilled_pipe(), dataset, tmp_path / "out", args, fine_tuning="yes", **SHORT)
        assert dict(vars(args)) == given and (tmp_path / "out" / "log.jsonl").exists()
        monkeypatch.setattr(adapting, "LEAST_FOR_FIELDS", 4)
        monkeypatch.setattr(adapting.Lab, "train_fields", lambda lab, args, accelerator: "Fields.")
        monkeypatch.setattr(adapting, "trains_decoder", lambda *_: False)
        pipe = distilled_pipe()
        pipe.dale.register_to_config(distilled_steps=1)
        adapt(pipe, dataset, tmp_path / "out", args, **SHORT)
        assert not any(path.name.startswith(("checkpoint-", "log")) for path in (tmp_path / "out").iterdir())
        record = json.loads((tmp_path / "out" / "training.json").read_text())
        assert record["steps"] == record["arguments"]["max_train_steps"] == 4
        assert "4 optimiser steps" in (tmp_path / "out" / "README.md").read_text()

    def test_the_decoder_is_trained_where_that_helps(self, distilled_pipe, dataset, tmp_path, capsys):
        pipe = distilled_pipe()
        before, teacher = _weights(pipe.lctg_distilled), _weights(pipe.lctg)
        pipe, verdict = adapt(pipe, dataset, tmp_path / "out", fine_tuning="yes", **SHORT)
        assert "The decoder of one step was trained for 4 updates: its energy score" in verdict
        saved = TactileTexturePipeline.from_pretrained(str(tmp_path / "out"))
        assert _differ(before, _weights(saved.lctg_distilled)) and not _differ(teacher, _weights(saved.lctg))
        assert saved.lctg_distilled.config.distilled_steps == 1 and verdict in (tmp_path / "out/README.md").read_text()
        assert json.loads((tmp_path / "out" / "training.json").read_text())["steps"] == 4

    def test_a_training_that_does_not_help_is_thrown_away(self, distilled_pipe, dataset, tmp_path):
        pipe = distilled_pipe()
        before = _weights(pipe.lctg_distilled)
        pipe, verdict = adapt(pipe, dataset, tmp_path / "out", fine_tuning="yes", **SHORT | {"learning_rate": 3.0})
        assert "so it stays as it is" in verdict and not _differ(before, _weights(pipe.lctg_distilled))

    def test_few_surfaces_and_wishes(self, distilled_pipe, make_pipeline):
        knows, does_not = DecoderFit(0.2, 0.2, 0.2, 0.2), DecoderFit(0.6, 0.2, 0.2, 0.2)
        few, enough = (SimpleNamespace(real=range(count)) for count in (3, 4))
        pipe = distilled_pipe()
        assert trains_decoder(pipe, enough, does_not, "auto") and trains_decoder(pipe, enough, knows, "yes")
        assert not trains_decoder(pipe, enough, knows, "auto") and not trains_decoder(pipe, enough, does_not, "no")
        assert not trains_decoder(pipe, few, does_not, "yes")
        assert not trains_decoder(make_pipeline(), enough, does_not, "yes")  # it has no decoder of one step

    def test_killed_and_resumed(self, distilled_pipe, dataset, tmp_path, monkeypatch):
        whole, _ = adapt(distilled_pipe(), dataset, tmp_path / "whole", fine_tuning="yes", **SHORT)
        save = Trainer.save_checkpoint

        def save_and_die(trainer):
            save(trainer)
            raise KeyboardInterrupt

        with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
            patched.setattr(Trainer, "save_checkpoint", save_and_die)
            adapt(distilled_pipe(), dataset, tmp_path / "cut", fine_tuning="yes", **SHORT)
        options = SHORT | {"resume_from_checkpoint": "latest", "fine_tuning": "yes"}
        resumed, _ = adapt(distilled_pipe(), dataset, tmp_path / "cut", **options)
        assert not _differ(_weights(whole.lctg_distilled), _weights(resumed.lctg_distilled))


@pytest.mark.parametrize(("rate", "samples", "fits"), [(2200, 4095, True), (2500, 4095, True), (2500, 4094, False)])
def test_segments_fit_within_a_sample_of_the_recordings(make_pipeline, rate, samples, fits):
    pipe = make_pipeline()
    pipe.lctg.register_to_config(segment_samples=4096)
    extractor = pipe.feature_extractor
    data = {"band": tuple(map(float, extractor.band)), "sampling_rate": 2500, "segment_samples": samples}
    data = SimpleNamespace(**data, attributes={"sampling_rate": rate})
    if fits:
        check_fit(pipe, data)
    else:
        with pytest.raises(ValueError, match="was trained on segments of"):
            check_fit(pipe, data)


def test_a_decoder_that_knows_textures_less_well_is_named(make_pipeline, dataset, monkeypatch):
    for ours, word in (((0.6, 0.2), "less well"), ((0.3, 0.9), "less well"), ((0.3, 0.3), "0.20 dB and 0.2.")):
        errors = iter([ours, (0.2, 0.2)])
        monkeypatch.setattr(further_training, "decoder_errors", lambda *args, errors=errors: next(errors))
        assert word in further_training.judge_decoder(make_pipeline(), dataset, 0).words()


class TestRefusals:
    def test_a_single_surface(self, make_pipeline, prepared, tmp_path):
        single = PreparedDataset(prepared, "train", "filtered", 2500, max_surfaces=1)
        with pytest.raises(ValueError, match="a single surface"):
            adapt(make_pipeline(), single, tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("option", "value"),
        [("max_train_step", 5), ("fine_tuning", "never"), ("max_train_steps", 0), ("quiet", 1), ("further", None)],
    )
    def test_options_are_checked_by_name(self, make_pipeline, dataset, tmp_path, option, value):
        with pytest.raises(ValueError, match=rf"--{option}\b.*{value}"):
            adapt(make_pipeline(), dataset, tmp_path / "out", **{option: value})
        assert not (tmp_path / "out").exists()

    def test_no_dale(self, make_pipeline, dataset, tmp_path):
        with pytest.raises(ValueError, match="has no DALE"):
            adapt(make_pipeline(dale=False), dataset, tmp_path / "out")

    def test_other_segments(self, evaluable_pipe, dataset, tmp_path):
        with pytest.raises(ValueError, match="segments of"):
            adapt(evaluable_pipe(), dataset, tmp_path / "out")

    def test_equal_ratings_are_said_to_move_no_slider(self, make_pipeline, dataset, tmp_path, capsys):
        dataset.ratings.mean[:] = 0.5
        pipe, _ = adapt(make_pipeline(), dataset, tmp_path / "out")
        assert "the sliders stay as they are" in capsys.readouterr().out
        assert not np.any(pipe.dale.config.calibration["slopes"])

    def test_the_command_refuses_in_a_line(self, make_pipeline, prepared, tmp_path, capsys):
        make_pipeline(dale=False).save_pretrained(tmp_path / "p")
        words = ["--train_data_dir", prepared, "--output_dir", tmp_path / "out"]
        words += ["--pretrained_model_name_or_path", tmp_path / "p"]
        assert command.main([*map(str, words)]) == 2
        assert "error: The checkpoint has no DALE" in capsys.readouterr().err

    def test_the_command_refuses_a_missing_tracker_in_a_line(
        self, make_pipeline, prepared, tmp_path, monkeypatch, capsys
    ):
        monkeypatch.setitem(sys.modules, "tensorboard", None)
        make_pipeline().save_pretrained(tmp_path / "p")
        words = ["--train_data_dir", prepared, "--output_dir", tmp_path / "out", "--report_to", "tensorboard"]
        words += ["--pretrained_model_name_or_path", tmp_path / "p"]
        assert command.main([*map(str, words)]) == 2
        assert "error: --report_to tensorboard needs: pip install" in capsys.readouterr().err
