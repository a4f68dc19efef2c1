"""`tactile-diffusers adapt`: fits a pretrained pipeline to the few surfaces of a lab."""

from ..data.dataset import PreparedDataset
from ..training.adapting import adapt, adaptation_parser
from ..training.launch import parse_training_arguments, starting
from .program import BUNDLED, checkpoint, command, load_pipeline

DESCRIPTION = """\
Adapts a pretrained pipeline to the few surfaces of a lab.

    tactile-diffusers adapt --train_data_dir prepared.h5 --output_dir adapted

The numbers of a whole texture (spectrum, level, friction, variation over time) are recalibrated in closed form. A
decoder that knows your textures less well than its own is then trained for some hundred updates. The result is a
whole pipeline: TactileTexturePipeline.from_pretrained("adapted").
"""


def parse_args(argv=None):
    """Arguments of the command."""
    parser = adaptation_parser(DESCRIPTION)
    parser.add_argument(
        "--pretrained_model_name_or_path",
        type=checkpoint,
        default=BUNDLED,
        help=f"pipeline that is adapted: a folder, a Hub id, or {BUNDLED!r}; default: {BUNDLED}",
    )
    return parse_training_arguments(parser, argv)


@command("adapt.py")
def main(argv=None):
    """Runs the command."""
    with starting():
        args = parse_args(argv)
        pipe = load_pipeline(args.pretrained_model_name_or_path)
        rate = pipe.feature_extractor.sampling_rate
        dataset = PreparedDataset(args.train_data_dir, "train", "filtered", rate, max_samples=args.max_train_samples)
    adapt(pipe, dataset, args.output_dir, args)
