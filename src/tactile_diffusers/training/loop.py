"""The training loop of both stages: optimiser steps, EMA, checkpoints that survive a kill, exact resume."""

import json
import logging
import math
import os
import time
from pathlib import Path

import torch
from diffusers.optimization import get_scheduler
from diffusers.training_utils import EMAModel
from diffusers.utils import SAFETENSORS_WEIGHTS_NAME
from safetensors.torch import load_file
from tqdm.auto import tqdm

from .batches import EndlessBatches
from .checkpoints import (
    checkpoints,
    clear_run,
    clear_unfinished,
    finish_checkpoint,
    last_good,
    latest_checkpoint,
    remove_checkpoint,
    step_of,
    unfinished_checkpoint,
    writing,
)
from .record import trim_log, write_record
from .steps import BatchNoise

logger = logging.getLogger(__name__)
#: Distance between the noise seeds of two training seeds: a prime near the golden section of 2^32, so that trainings of
#: neighbouring seeds never meet.
_SEED_STRIDE = 0x9E3779B1
#: Updates between two lines of the log.
_LOGGING_STEPS = 50


class Trainer:
    """Runs a training: `Trainer(...).run()`.

    Args:
        accelerator (`Accelerator`): from `make_accelerator`.
        args (`argparse.Namespace`): with the arguments of `training_parser`.
        step_module (`torch.nn.Module`): `step_module(batch, random)` returns (loss, dict of scalars), means over the
            rows of the batch; the model to train is its attribute `model` (a diffusers `ModelMixin`), and `random` a
            `BatchNoise`.
        name (`str`): of the model in checkpoint folders.
        dataset: indexable, with `__len__`.
        collate (`Callable`, *optional*): items -> batch (a dict of tensors); `None` = stacked.
        validate (`Callable`, *optional*): `validate(model)` -> dict of scalars; called with the averaged weights.
        surfaces (`dict`, *optional*): of `surfaces_of`, for `training.json`.
    """

    def __init__(self, accelerator, args, step_module, name, dataset, collate=None, validate=None, surfaces=None):
        self.accelerator, self.args, self.name, self.validate = accelerator, args, name, validate
        self.dataset, self.collate, self.module, self.surfaces = dataset, collate, step_module, surfaces
        self.output, processes = Path(args.output_dir), accelerator.num_processes
        batches = max(1, len(dataset) // args.train_batch_size // processes)
        updates_per_epoch = math.ceil(batches / args.gradient_accumulation_steps)
        self.total_steps = args.max_train_steps or args.num_train_epochs * updates_per_epoch
        self.optimizer = torch.optim.AdamW(
            [p for p in step_module.parameters() if p.requires_grad],
            lr=args.learning_rate,
            betas=(args.adam_beta1, args.adam_beta2),
            weight_decay=args.adam_weight_decay,
        )
        # the prepared scheduler advances once per process and update: count both warm-up and total so
        self.lr_scheduler = get_scheduler(
            args.lr_scheduler,
            optimizer=self.optimizer,
            num_warmup_steps=args.lr_warmup_steps * processes,
            num_training_steps=self.total_steps * processes,
        )
        self.ema = self._make_ema() if args.use_ema else None
        accelerator.register_save_state_pre_hook(self._save_models)
        accelerator.register_load_state_pre_hook(self._load_models)
        self.step, self.seconds, self.owes_validation = 0, 0.0, False

    @property
    def model(self):
        """The model that is trained, out of the wrapper of several processes."""
        return self.accelerator.unwrap_model(self.module).model

    def run(self):
        """Trains to the end and returns the model with averaged weights, in eval mode."""
        args, accelerator = self.args, self.accelerator
        self.module.train()
        self.module, self.optimizer, self.lr_scheduler = accelerator.prepare(
            self.module, self.optimizer, self.lr_scheduler
        )
        self.sampler = EndlessBatches(
            len(self.dataset), args.train_batch_size, args.seed, processes=accelerator.num_processes
        )
        self._resume()
        loader = self._make_loader()
        self._start_tracker()
        logger.info(
            "***** Running training ***** segments %d, batch %d x %d, steps %d, parameters %.2f M, %s",
            len(self.dataset), args.train_batch_size, args.gradient_accumulation_steps, self.total_steps,
            sum(p.numel() for p in self.optimizer.param_groups[0]["params"]) / 1e6, accelerator.device,
        )  # fmt: skip
        if accelerator.is_main_process:
            with writing("training.json", self.output):
                write_record(args, accelerator, len(self.dataset), self.total_steps, self.surfaces)
        if self.owes_validation:
            self._validate()
        self._loop(loader)
        if self.step % args.checkpointing_steps:
            self.save_checkpoint()
        with writing("The log of the tracker", self.output):
            accelerator.end_training()
        model = self.model
        if self.ema is not None:
            self.ema.copy_to(model.parameters())
        return model.eval()

    def _make_ema(self):
        args, model = self.args, self.module.model
        ema = EMAModel(
            model.parameters(), decay=args.ema_decay, use_ema_warmup=True, power=0.75, model_cls=type(model),
            model_config=model.config,
        )  # fmt: skip
        ema.to(self.accelerator.device)
        return ema

    def _make_loader(self):
        self.sampler.start = self.step * self.args.gradient_accumulation_steps * self.accelerator.num_processes
        loader = torch.utils.data.DataLoader(
            self.dataset,
            batch_sampler=self.sampler,
            collate_fn=self.collate,
            num_workers=self.args.dataloader_num_workers,
            # its own: a loader draws once when it starts, which an unbroken training does once and a resumed one twice
            generator=torch.Generator(),
        )
        return self.accelerator.prepare(loader)

    def _start_tracker(self):
        if self.args.report_to != "none":
            plain = {name: value for name, value in vars(self.args).items() if isinstance(value, int | float | str)}
            with writing("The log of the tracker", self.output):
                self.accelerator.init_trackers("tactile_diffusers", plain)

    # --- the loop

    def _loop(self, loader):
        args, accelerator = self.args, self.accelerator
        quiet = args.quiet or not accelerator.is_main_process
        bar = tqdm(total=self.total_steps, initial=self.step, disable=quiet, desc=self.name, mininterval=5)
        micro, sums, count, began = 0, {}, 0, time.time() - self.seconds
        for batch in loader:
            if self.step >= self.total_steps:
                break
            scalars = self._update(batch, self.step * args.gradient_accumulation_steps + micro)
            micro = (micro + 1) % args.gradient_accumulation_steps
            sums = {key: sums.get(key, 0.0) + value for key, value in scalars.items()}
            count += 1
            if not accelerator.sync_gradients:
                continue
            self.step += 1
            bar.update()
            if self.ema is not None:
                self.ema.step(self.model.parameters())
            if self.step % _LOGGING_STEPS == 0 or self.step == self.total_steps:
                # rows of all processes count: the mean over processes, which have equally many
                sums = dict(zip(sums, accelerator.reduce(torch.stack(list(sums.values())), "mean"), strict=True))
                means = {f"train/{k}": float(v) / count for k, v in sums.items()}
                self._log({**means, "lr": self.lr_scheduler.get_last_lr()[0], "seconds": time.time() - began})
                bar.set_postfix(loss=means["train/loss"], refresh=False)
                sums, count = {}, 0
            if self.step % args.checkpointing_steps == 0:
                self.save_checkpoint()
            if self._validates_now():
                self._validate()
        bar.close()

    def _update(self, batch, number):
        """Forward, backward and, at the end of an accumulation, the optimiser; returns loss and scalars.

        Args:
            batch (`dict[str, torch.Tensor]`): of this process.
            number (`int`): of the batch since the beginning of the training.
        """
        accelerator = self.accelerator
        with accelerator.accumulate(self.module):
            with accelerator.autocast():
                loss, scalars = self.module(batch, self._noise(number))
            if not torch.isfinite(loss):
                own = number * accelerator.num_processes + accelerator.process_index
                raise self._not_finite(f"The loss is {loss.item()}", [own])
            accelerator.backward(loss)
            if accelerator.sync_gradients:
                norm = accelerator.clip_grad_norm_(self.module.parameters(), self.args.max_grad_norm)
                # with a scaler (fp16) too large gradients are expected: it leaves the step out
                if accelerator.scaler is None and not torch.isfinite(norm):
                    batches = self.args.gradient_accumulation_steps * accelerator.num_processes
                    all_of_them = range(self.step * batches, (self.step + 1) * batches)
                    raise self._not_finite(f"The norm of the gradient is {norm.item()}, of a finite loss,", all_of_them)
            self.optimizer.step()
            self.lr_scheduler.step()
            self.optimizer.zero_grad()
        return {"loss": loss.detach(), **scalars}

    def _noise(self, number):
        """`BatchNoise` that depends on the seed and the batch's number alone: the same after a resume."""
        accelerator = self.accelerator
        # the CPU's generator reads 32 bits of its seed; a seed that is shifted up would go unread
        seed = (self.args.seed * _SEED_STRIDE + number) % 2**32
        generator = torch.Generator(accelerator.device).manual_seed(seed)
        return BatchNoise(generator, accelerator.device, (accelerator.process_index, accelerator.num_processes))

    def _not_finite(self, what, batches):
        """The error that stops the training: `batches` are the numbers of those that led to it."""
        indices = [index for number in batches for index in self.sampler.batch(number)]
        return FloatingPointError(
            f"{what} in step {self.step + 1}. The batch is made of the segments with indices {indices} of the training "
            f"set: look at them, or lower --learning_rate. {last_good(self.output)}"
        )

    def _log(self, values):
        with writing("The log", self.output):
            self.accelerator.log(values, step=self.step)
            if self.accelerator.is_main_process:
                with open(self.output / "log.jsonl", "a") as file:
                    file.write(json.dumps({"step": self.step, **values}) + "\n")

    def _validates_now(self):
        return bool(self.validate) and (self.step % self.args.validation_steps == 0 or self.step == self.total_steps)

    def _validate(self):
        model = self.model
        if self.ema is not None:
            self.ema.store(model.parameters())
            self.ema.copy_to(model.parameters())
        model.eval()
        if self.accelerator.is_main_process:
            with torch.no_grad():
                self._log({f"validation/{name}": float(value) for name, value in self.validate(model).items()})
        model.train()
        if self.ema is not None:
            self.ema.restore(model.parameters())

    # --- checkpoints: accelerate keeps optimiser, learning rate and random state; weights are in diffusers' format

    def _save_models(self, models, weights, folder):
        if self.accelerator.is_main_process:
            for module in models:
                self.accelerator.unwrap_model(module).model.save_pretrained(os.path.join(folder, self.name))
            if self.ema is not None:
                self.ema.save_pretrained(os.path.join(folder, f"{self.name}_ema"))
        weights.clear()  # on every process: nothing left for accelerate to save

    def _load_models(self, models, folder):
        while models:
            model = self.accelerator.unwrap_model(models.pop()).model
            loaded = type(model).from_pretrained(folder, subfolder=self.name)
            model.load_state_dict(loaded.state_dict())
        if self.ema is not None:
            # not by EMAModel.from_pretrained, which warns that a model's config has the settings of an average
            averaged = Path(folder, f"{self.name}_ema")
            weights = load_file(averaged / SAFETENSORS_WEIGHTS_NAME)
            shadow = [weights[name] for name, _ in self.model.named_parameters()]
            self.ema.load_state_dict({**self.model.load_config(averaged), "shadow_params": shadow})
            self.ema.to(self.accelerator.device)

    def save_checkpoint(self):
        """Writes `checkpoint-<step>` under a temporary name, renames it, and only then removes the oldest ones.

        Raises:
            FloatingPointError: if a weight is not finite.
            OSError: if it cannot be written; the message says how to continue.
        """
        if not all(parameter.isfinite().all() for parameter in self.module.parameters()):
            raise FloatingPointError(
                f"Weights are not finite after step {self.step}, so that no checkpoint was written. Lower "
                f"--learning_rate. {last_good(self.output)}"
            )
        main, temporary = self.accelerator.is_main_process, unfinished_checkpoint(self.output, self.step)
        with writing(f"The checkpoint of step {self.step}", self.output, temporary if main else None):
            self.accelerator.save_state(str(temporary), safe_serialization=True)
            self.accelerator.wait_for_everyone()
            if not main:
                return
            finish_checkpoint(temporary)
        if self.args.checkpoints_total_limit:
            for old in checkpoints(self.output)[: -self.args.checkpoints_total_limit]:
                remove_checkpoint(old)

    def _resume(self):
        """Loads the checkpoint that was asked for, or clears the folder for a new training."""
        wanted, main = self.args.resume_from_checkpoint, self.accelerator.is_main_process
        if main:
            clear_unfinished(self.output)
        if not wanted:
            if main:  # only now, when nothing is left that could refuse to start
                clear_run(self.output)
            return
        folder = latest_checkpoint(self.output) if wanted == "latest" else Path(wanted)
        if folder is None:
            logger.info("No checkpoint in %s yet: starting from the beginning.", self.output)
            if main:
                trim_log(self.output, 0)
            return
        self.accelerator.load_state(str(folder))
        self.step = step_of(folder)
        left = self.total_steps - self.step
        logger.info("Resumed from %s: %s", folder, f"{left} steps are left" if left > 0 else "nothing is left to train")
        if main:
            self._forget_later_steps(folder)

    def _forget_later_steps(self, folder):
        """Removes checkpoints and lines of the log that came after the checkpoint `folder`: they will come again."""
        for other in checkpoints(self.output):
            # or it would be the latest, and the first that is written now the oldest
            if step_of(other) >= self.step and not other.samefile(folder):
                logger.info("Removing %s: the training continues from an earlier step", other)
                remove_checkpoint(other)
        entries = trim_log(self.output, self.step)
        self.seconds = max((entry.get("seconds", 0.0) for entry in entries), default=0.0)
        # the checkpoint is written before the validation of its step, which a kill can take away
        known = {entry["step"] for entry in entries if any(key.startswith("validation/") for key in entry)}
        self.owes_validation = self._validates_now() and self.step not in known
