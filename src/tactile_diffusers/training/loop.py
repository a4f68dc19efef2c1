"""The training loop of both stages: optimiser steps, EMA, checkpoints that survive a kill, exact resume."""

import json
import logging
import math
import os
import platform
import shutil
import sys
import time
from pathlib import Path

import diffusers
import torch
from accelerate import Accelerator
from accelerate.utils import DataLoaderConfiguration, ProjectConfiguration, set_seed
from diffusers.optimization import get_scheduler
from diffusers.training_utils import EMAModel
from tqdm.auto import tqdm

from ..io.files import write_text
from ..io.locks import lock_folder
from .batches import EndlessBatches
from .checkpoints import (
    checkpoints,
    clear_unfinished,
    finish_checkpoint,
    last_good,
    latest_checkpoint,
    remove_checkpoint,
    step_of,
    unfinished_checkpoint,
    writing,
)
from .processes import on_cpu
from .record import trim_log
from .surfaces import surfaces_of

logger = logging.getLogger(__name__)
#: Distance between the noise seeds of two training seeds: a prime near the golden section of 2^32, so that trainings of
#: neighbouring seeds never meet.
_SEED_STRIDE = 0x9E3779B1


def make_accelerator(args):
    """Accelerator, seeds and the tracker for parsed arguments.

    The output folder is this process's until `training.ending.finish`, or until the process ends, however it does.

    Raises:
        ValueError: if the output folder holds another training, or another process trains there.
        ImportError: if the tracker is not installed, naming the extra.
    """
    output = Path(args.output_dir)
    used = output.is_dir() and any(step_of(p) is not None or p.name == "log.jsonl" for p in output.iterdir())
    if used and not args.overwrite_output_dir and not args.resume_from_checkpoint:
        raise ValueError(
            f"--output_dir {output} already holds a training. Give --resume_from_checkpoint latest to go on, or "
            "--overwrite_output_dir to start again."
        )
    if args.report_to in ("tensorboard", "all"):
        try:
            import tensorboard  # noqa: F401
        except ImportError as error:
            raise ImportError(
                f'--report_to {args.report_to} needs: pip install "tactile-diffusers[training]"; or give '
                "--report_to none."
            ) from error
    if args.allow_tf32:
        torch.backends.cuda.matmul.allow_tf32 = True
    project = ProjectConfiguration(project_dir=args.output_dir, logging_dir=str(output / args.logging_dir))
    accelerator = Accelerator(
        cpu=on_cpu(),
        gradient_accumulation_steps=args.gradient_accumulation_steps,
        mixed_precision=args.mixed_precision,
        log_with=None if args.report_to == "none" else args.report_to,
        project_config=project,
        # each process takes its own batches of the endless sampler; nothing is gathered at an epoch's end
        dataloader_config=DataLoaderConfiguration(even_batches=False),
    )
    if accelerator.is_main_process:
        output.mkdir(parents=True, exist_ok=True)
        lock_folder(output, "--output_dir")
    logging.basicConfig(format="%(asctime)s %(message)s", level=logging.INFO if accelerator.is_main_process else 40)
    set_seed(args.seed)
    return accelerator


class Trainer:
    """Runs a training: `Trainer(...).run()`.

    Args:
        accelerator (`Accelerator`): from `make_accelerator`.
        args (`argparse.Namespace`): with what `add_training_arguments` adds.
        step_module (`torch.nn.Module`): `step_module(batch, generator)` returns (loss, dict of scalars), means over the
            rows of the batch; the model to train is its attribute `model` (a diffusers `ModelMixin`). The generator's
            state is the same in every process: draw with `Draws`.
        name (`str`): of the model in checkpoint folders.
        dataset: indexable, with `__len__`.
        collate (`Callable`, *optional*): items -> batch (a dict of tensors); `None` = stacked.
        validate (`Callable`, *optional*): `validate(model, step)` -> dict of scalars; called with the averaged weights.
    """

    def __init__(self, accelerator, args, step_module, name, dataset, collate, validate):
        self.accelerator, self.args, self.name, self.validate = accelerator, args, name, validate
        self.dataset, self.collate, self.module = dataset, collate, step_module
        self.output = Path(args.output_dir)
        if args.gradient_checkpointing:
            step_module.model.enable_gradient_checkpointing()
        batches = max(1, len(dataset) // args.train_batch_size // accelerator.num_processes)
        updates_per_epoch = math.ceil(batches / args.gradient_accumulation_steps)
        self.total_steps = args.max_train_steps or args.num_train_epochs * updates_per_epoch
        rate = args.learning_rate
        if args.scale_lr:
            rate *= args.gradient_accumulation_steps * args.train_batch_size * accelerator.num_processes
        parameters = [p for p in step_module.parameters() if p.requires_grad]
        self.optimizer = torch.optim.AdamW(
            parameters,
            lr=rate,
            betas=(args.adam_beta1, args.adam_beta2),
            weight_decay=args.adam_weight_decay,
            eps=args.adam_epsilon,
        )
        # the prepared scheduler advances once per process and update: count both warm-up and total so
        processes = accelerator.num_processes
        self.lr_scheduler = get_scheduler(
            args.lr_scheduler,
            optimizer=self.optimizer,
            num_warmup_steps=args.lr_warmup_steps * processes,
            num_training_steps=self.total_steps * processes,
        )
        self.ema = None
        if args.use_ema:
            model = step_module.model
            self.ema = EMAModel(
                model.parameters(), decay=args.ema_decay, use_ema_warmup=True, inv_gamma=args.ema_inv_gamma,
                power=args.ema_power, foreach=args.foreach_ema, model_cls=type(model), model_config=model.config,
            )  # fmt: skip
            self.ema.to(accelerator.device)
        accelerator.register_save_state_pre_hook(self._save_models)
        accelerator.register_load_state_pre_hook(self._load_models)
        self.step, self.seconds, self.owes_validation = 0, 0.0, False

    # accelerate's own files hold optimiser, learning rate and random state; the weights go to diffusers' format
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
            cls = type(self.accelerator.unwrap_model(self.module).model)
            loaded = EMAModel.from_pretrained(os.path.join(folder, f"{self.name}_ema"), cls)
            self.ema.load_state_dict(loaded.state_dict())
            self.ema.to(self.accelerator.device)

    def save_checkpoint(self):
        """Writes `checkpoint-<step>` under a temporary name, renames it, and only then removes the oldest ones.

        Raises:
            FloatingPointError: if a weight is not finite.
            OSError: if it cannot be written, telling how to go on.
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
        wanted, main = self.args.resume_from_checkpoint, self.accelerator.is_main_process
        if main:
            clear_unfinished(self.output)
        if not wanted:
            if main:  # only now, when nothing is left that could refuse to start
                for path in checkpoints(self.output):
                    remove_checkpoint(path)
                shutil.rmtree(self.output / self.args.logging_dir, ignore_errors=True)
                (self.output / "log.jsonl").unlink(missing_ok=True)
            return
        folder = latest_checkpoint(self.output) if wanted == "latest" else Path(wanted)
        if folder is None:
            logger.info("No checkpoint in %s yet: starting from the beginning.", self.output)
            if main:
                trim_log(self.output, 0)
            return
        if not folder.is_dir() or step_of(folder) is None:
            raise ValueError(f"--resume_from_checkpoint {wanted} is neither 'latest' nor a folder checkpoint-<step>.")
        self.accelerator.load_state(str(folder))
        self.step = step_of(folder)
        logger.info("Resumed from %s", folder)
        if main:  # what came after the checkpoint will come again
            for other in checkpoints(self.output):
                # or it would be the latest, and the first that is written now the oldest
                if step_of(other) >= self.step and not other.samefile(folder):
                    logger.info("Removing %s, which the training now goes another way to", other)
                    remove_checkpoint(other)
            entries = trim_log(self.output, self.step)
            self.seconds = max((entry.get("seconds", 0.0) for entry in entries), default=0.0)
            # the checkpoint comes first: a kill after it takes the validation of its step
            known = {entry["step"] for entry in entries if any(key.startswith("validation/") for key in entry)}
            self.owes_validation = self._validates_now() and self.step not in known

    def _describe(self):
        """Writes `training.json`: the command, the data, the machine and the versions, for the model card."""
        script, defaults = Path(sys.argv[0]), getattr(self.args, "defaults", {})
        kept = ("defaults", "hub_token")  # a secret is written nowhere
        arguments = {k: v for k, v in vars(self.args).items() if v is not None and k not in kept}
        record = {
            "script": f"{script.parent.name}/{script.name}",
            "arguments": arguments,
            "changed": {k: v for k, v in arguments.items() if k not in defaults or v != defaults[k]},
            "segments": len(self.dataset),
            "trained_on": surfaces_of(self.dataset),
            "steps": self.total_steps,
            "processes": self.accelerator.num_processes,  # the global batch is that of each, times these
            "machine": f"{platform.machine()}, {torch.get_num_threads()} thread(s), {self.accelerator.device}",
            "versions": {"torch": torch.__version__, "diffusers": diffusers.__version__},
        }
        with writing("training.json", self.output):
            write_text(self.output / "training.json", json.dumps(record, indent=2) + "\n")

    def _log(self, values):
        with writing("The log", self.output):
            self.accelerator.log(values, step=self.step)
            if self.accelerator.is_main_process:
                with open(self.output / "log.jsonl", "a") as file:
                    file.write(json.dumps({"step": self.step, **values}) + "\n")

    def _not_finite(self, what, batches):
        """The error that stops the training: `batches` are the numbers of those that led to it."""
        indices = [index for number in batches for index in self.sampler.batch(number)]
        return FloatingPointError(
            f"{what} in step {self.step + 1}. The batch is made of the segments with indices {indices} of the training "
            f"set: look at them, or lower --learning_rate. {last_good(self.output)}"
        )

    def _validates_now(self):
        return bool(self.validate) and (self.step % self.args.validation_steps == 0 or self.step == self.total_steps)

    def _validate(self):
        model = self.accelerator.unwrap_model(self.module).model
        if self.ema is not None:
            self.ema.store(model.parameters())
            self.ema.copy_to(model.parameters())
        model.eval()
        if self.accelerator.is_main_process:
            with torch.no_grad():
                self._log({f"validation/{k}": float(v) for k, v in self.validate(model, self.step).items()})
        model.train()
        if self.ema is not None:
            self.ema.restore(model.parameters())

    def run(self):
        """Trains to the end and returns the model with averaged weights, in eval mode."""
        args, accelerator = self.args, self.accelerator
        self.module.train()
        self.module, self.optimizer, self.lr_scheduler = accelerator.prepare(
            self.module, self.optimizer, self.lr_scheduler
        )
        self.sampler = sampler = EndlessBatches(
            len(self.dataset), args.train_batch_size, args.seed, processes=accelerator.num_processes
        )
        self._resume()
        sampler.start = self.step * args.gradient_accumulation_steps * accelerator.num_processes
        loader = torch.utils.data.DataLoader(
            self.dataset,
            batch_sampler=sampler,
            collate_fn=self.collate,
            num_workers=args.dataloader_num_workers,
            # its own: a loader draws once when it starts, which an unbroken training does once and a resumed one twice
            generator=torch.Generator(),
        )
        loader = accelerator.prepare(loader)
        if args.report_to != "none":
            told = {k: v for k, v in vars(args).items() if k != "hub_token"}
            config = {k: v for k, v in told.items() if isinstance(v, int | float | str | bool)}
            with writing("The log of the tracker", self.output):
                accelerator.init_trackers(args.tracker_project_name, config)
        logger.info(
            "***** Running training ***** segments %d, batch %d x %d, steps %d, parameters %.2f M, %s",
            len(self.dataset), args.train_batch_size, args.gradient_accumulation_steps, self.total_steps,
            sum(p.numel() for p in self.optimizer.param_groups[0]["params"]) / 1e6, accelerator.device,
        )  # fmt: skip
        if accelerator.is_main_process:
            self._describe()
        if self.owes_validation:
            self._validate()
        self._loop(loader)
        if self.step % args.checkpointing_steps:
            self.save_checkpoint()
        with writing("The log of the tracker", self.output):
            accelerator.end_training()
        model = accelerator.unwrap_model(self.module).model
        if self.ema is not None:
            self.ema.copy_to(model.parameters())
        return model.eval()

    def _loop(self, loader):
        args, accelerator = self.args, self.accelerator
        quiet = args.quiet or not accelerator.is_main_process
        bar = tqdm(total=self.total_steps, initial=self.step, disable=quiet, desc=self.name, mininterval=5)
        micro, sums, count, began = 0, {}, 0, time.time() - self.seconds
        for batch in loader:
            if self.step >= self.total_steps:
                break
            # noise and times depend on the seed and the step alone, so that a resumed run equals an unbroken one, and
            # so do several processes one process
            draw = self.step * args.gradient_accumulation_steps + micro
            # the CPU's generator reads 32 bits of its seed; a seed that is shifted up would go unread
            seed = (args.seed * _SEED_STRIDE + draw) % 2**32
            generator = torch.Generator(accelerator.device).manual_seed(seed)
            micro = (micro + 1) % args.gradient_accumulation_steps
            with accelerator.accumulate(self.module):
                with accelerator.autocast():
                    loss, scalars = self.module(batch, generator)
                if not torch.isfinite(loss):
                    turn = draw * accelerator.num_processes + accelerator.process_index
                    raise self._not_finite(f"The loss is {loss.item()}", [turn])
                accelerator.backward(loss)
                if accelerator.sync_gradients:
                    norm = accelerator.clip_grad_norm_(self.module.parameters(), args.max_grad_norm)
                    # with a scaler (fp16), gradients that are too large are nothing unusual: it leaves the step out
                    if accelerator.scaler is None and not torch.isfinite(norm):
                        turns = args.gradient_accumulation_steps * accelerator.num_processes
                        batches = range(self.step * turns, (self.step + 1) * turns)
                        raise self._not_finite(f"The norm of the gradient is {norm.item()}, of a finite loss,", batches)
                self.optimizer.step()
                self.lr_scheduler.step()
                self.optimizer.zero_grad()
            for key, value in {"loss": loss.detach(), **scalars}.items():
                sums[key] = sums.get(key, 0.0) + value
            count += 1
            if not accelerator.sync_gradients:
                continue
            self.step += 1
            bar.update()
            if self.ema is not None:
                self.ema.step(accelerator.unwrap_model(self.module).model.parameters())
            if self.step % 50 == 0 or self.step == self.total_steps:
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
