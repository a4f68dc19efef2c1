"""For `DiffusionPipeline.from_pretrained(folder, custom_pipeline="pipeline", trust_remote_code=True)`."""

from tactile_diffusers import TactileTexturePipeline  # noqa: F401
