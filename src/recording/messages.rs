//! The messages of a trace file, generated from `proto/`, their schemas and topics.

use std::borrow::Cow;

/// Foxglove's well-known schemas.
#[allow(clippy::all, missing_docs)]
pub mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/recording/foxglove.rs"));
}

/// Our own messages.
#[allow(clippy::all, missing_docs)]
pub mod v1 {
    include!(concat!(env!("OUT_DIR"), "/recording/vrdp.v1.rs"));
}

macro_rules! descriptors {
    ($stem:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/recording/", $stem, ".bin"))
    };
}

/// A topic of a trace file and what is on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    pub name: Cow<'static, str>,
    /// Full name of the message.
    pub schema: &'static str,
    /// Its file and all that the file imports, as a `FileDescriptorSet`.
    pub descriptors: &'static [u8],
}

const OWN: &[u8] = descriptors!("recording");
const POSE: &[u8] = descriptors!("pose");

const fn topic(name: &'static str, schema: &'static str, descriptors: &'static [u8]) -> Topic {
    Topic { name: Cow::Borrowed(name), schema, descriptors }
}

pub const PARAMETERS: Topic = topic("/parameters", "vrdp.v1.TraceParameters", OWN);
pub const MEASURED: Topic = topic("/measured/poses", "foxglove.PosesInFrame", POSE);
pub const POSES: Topic = topic("/simulated/poses", "foxglove.PosesInFrame", POSE);
pub const SHAPES: Topic = topic("/simulated/scene", "foxglove.SceneUpdate", descriptors!("scene"));
pub const TRANSFORMS: Topic = topic("/simulated/transforms", "foxglove.FrameTransforms", POSE);
pub const STATES: Topic = topic("/simulated/states", "vrdp.v1.TraceFrame", OWN);
pub const RESIDUALS: Topic = topic("/residual/positions", "vrdp.v1.TraceResiduals", OWN);
pub const EVENTS: Topic = topic("/events", "vrdp.v1.TraceEvent", OWN);
pub const LOG: Topic = topic("/log", "foxglove.Log", descriptors!("log"));
pub const MEAN: Topic = topic("/ensemble/mean", "vrdp.v1.TraceFrame", OWN);
pub const MEAN_POSES: Topic = topic("/ensemble/mean/poses", "foxglove.PosesInFrame", POSE);

pub const IMAGE: Topic = topic("/camera/image", "foxglove.CompressedImage", descriptors!("image"));
pub const ANNOTATIONS: Topic =
    topic("/camera/annotations", "foxglove.ImageAnnotations", descriptors!("image"));

pub const ROLLOUTS: Topic = topic("/ensemble/rollouts", "vrdp.v1.TraceRollouts", OWN);

/// Every topic of a simulation; messages of equal time stand in this order. Those of the ensemble and of the stills follow.
pub const SIMULATION: [Topic; 9] =
    [PARAMETERS, MEASURED, POSES, SHAPES, TRANSFORMS, STATES, RESIDUALS, EVENTS, LOG];

pub const BEFORE_POSES: Topic = topic("/before/poses", "foxglove.PosesInFrame", POSE);
pub const AFTER_POSES: Topic = topic("/after/poses", "foxglove.PosesInFrame", POSE);
pub const BEFORE: Topic = topic("/before/states", "vrdp.v1.TraceFrame", OWN);
pub const AFTER: Topic = topic("/after/states", "vrdp.v1.TraceFrame", OWN);
pub const RESIDUALS_BEFORE: Topic = topic("/residual/before", "vrdp.v1.TraceResiduals", OWN);
pub const RESIDUALS_AFTER: Topic = topic("/residual/after", "vrdp.v1.TraceResiduals", OWN);
pub const LOSS: Topic = topic("/loss", "vrdp.v1.TraceIteration", OWN);
pub const REVISIONS: Topic = topic("/revisions", "vrdp.v1.TraceRevision", OWN);

/// Every topic of what a fit or a discovery did to a model.
pub const CHANGE: [Topic; 10] = [
    PARAMETERS,
    MEASURED,
    BEFORE_POSES,
    AFTER_POSES,
    BEFORE,
    AFTER,
    RESIDUALS_BEFORE,
    RESIDUALS_AFTER,
    LOSS,
    REVISIONS,
];
