"""Names of representations: what an agent observes, such as `full` or `dae12-observation`.

There are no heavy imports here, so help and completion are fast.
"""

import re

_KINDS = {
    "dae": ("autoencoders:DenoisingAutoencoder", "latents of a denoising autoencoder"),
    "dae-yaw": (
        "autoencoders:DenoisingAutoencoderWithYawRate",
        "dae with the yaw rate as a latent",
    ),
    "ae": ("autoencoders:Autoencoder", "latents of an autoencoder"),
    "ddae": (
        "autoencoders:DynamicDenoisingAutoencoder",
        "latents of an autoencoder that predicts the next states",
    ),
    "vae": ("variational:VariationalAutoencoder", "latents of a variational autoencoder"),
    "lld-vae": (
        "variational:LocallyLinearVariationalAutoencoder",
        "vae with locally linear dynamics",
    ),
    "pca": ("linear:PrincipalComponents", "principal components"),
    "random": ("linear:RandomProjection", "random projection"),
    "scaled": ("linear:Scaled", "all features, scaled as encoders scale them"),
    "planar": ("planar:PlanarReduction", "scaled, without position and heading in the plane"),
    "planar-no-yaw": ("planar:PlanarWithoutYawRate", "planar without the yaw rate"),
    "heading": ("planar:HeadingFrame", "planar with position and heading"),
    "raw": ("linear:Raw", "the observation in SI units"),
    "planar-mirror": ("planar:PlanarMirror", "planar, folded by the mirror symmetry"),
    "forward": ("predictive:ForwardModel", "latents that predict the next states and the reward"),
    "inverse": ("predictive:InverseModel", "latents that predict the action"),
    "dmd": ("linear:DynamicModes", "directions of a linear model of the dynamics"),
    "contrastive": (
        "predictive:Contrastive",
        "latents that tell the future of a state from others",
    ),
    "random-features": ("linear:RandomFeatures", "tanh of random directions"),
}
"""Built-in kinds of encoders: the class in jbench.encoders.kinds, and what the latents are."""

ENCODER_KINDS = {kind: f"jbench.encoders.kinds.{path}" for kind, (path, _) in _KINDS.items()}
"""Built-in kinds of encoders and their classes; other packages may add kinds."""

LATENTS = 12
"""Latents of an encoder for which none are typed, as of the paper's autoencoder."""

MEANINGS = {
    "full": "the observation of the task",
    **{kind: meaning for kind, (_, meaning) in _KINDS.items()},
    "ofe": "features that are learned with the agent",
    "-without-": "without these features of the observation",
    "-of-": "of these features of the observation",
    "-script": "trained as in the authors' script",
    "-observation": "inputs on the observation's scale",
    "-sd": "inputs scaled to unit variance",
    "-whitened": "latents whitened",
    "-standardized": "latents scaled to mean 0 and standard deviation 1",
    "-extremes": "latents scaled to their extremes",
}
"""What representations and the endings of their names mean, in a few words."""


FULL = "full"  # representation of an agent without an encoder
NO_ENCODER = ("none", FULL)  # values of `--encoder` for such an agent
OFE = "ofe"  # prefix of the representation if features are learned with the agent, such as ofe12

_SCALES = "observation|sd"
_RESCALES = "whitened|standardized|extremes"

REPRESENTATION = re.compile(
    r"(?P<kind>[a-z][a-z0-9-]*?):?(?P<latents>[0-9]+)?(?P<endings>"
    r"(?:-(?P<features>(?:without|of)-[A-Za-z0-9_.]+|features-[0-9a-f]{8}))?"
    r"(?:-(?P<base>script))?"
    # Only after a number of latents: planar-no-yaw is a kind.
    rf"(?(latents)(?P<options>(?:-(?!(?:{_SCALES}|{_RESCALES})\b)[a-z_]+-[A-Za-z0-9_.]+)*))"
    rf"(?:-(?P<scale>{_SCALES}))?(?:-(?P<rescale>{_RESCALES}))?)"
)
"""A representation: a kind of encoder, its number of latents, and what is not the default: features
of the observation, training, options and scales, such as dae12, dae12-noise-0.2 or
dae12-observation-whitened."""


def features_in(representation: str) -> str:
    """Returns which features of the observation a representation is of: "" for all.

    Those of dae8-without-velocity and of raw10-without-velocity are without-velocity.
    """
    match = REPRESENTATION.fullmatch(representation)
    if match is None:
        return ""
    return match["features"] or ""


# Kinds whose number of latents follows from the task, so that names leave it out.
_SIZE_OF_TASK = ("scaled", "planar", "planar-no-yaw", "planar-mirror", "heading", "raw")


def kind_in(representation: str) -> str:
    """Returns the kind of a representation, such as `scaled` for scaled16."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None:
        return representation.rstrip("0123456789")
    return match["kind"]


def shown_representation(representation: str) -> str:
    """Returns a representation's name, without a size that the task determines."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None or match["kind"] not in _SIZE_OF_TASK:
        return representation
    return match["kind"] + match["endings"]
