//! The messages of a trace file, generated from `proto/`, and their schemas.

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
#[derive(Debug, Clone, Copy)]
pub struct Topic {
    pub name: &'static str,
    /// Full name of the message.
    pub schema: &'static str,
    /// Its file and all that the file imports, as a `FileDescriptorSet`.
    pub descriptors: &'static [u8],
}

const fn topic(name: &'static str, schema: &'static str, descriptors: &'static [u8]) -> Topic {
    Topic { name, schema, descriptors }
}

pub const PARAMETERS: Topic = topic("/parameters", "vrdp.v1.TraceParameters", descriptors!("recording"));
pub const MEASURED: Topic = topic("/measured/poses", "foxglove.PosesInFrame", descriptors!("pose"));
pub const POSES: Topic = topic("/simulated/poses", "foxglove.PosesInFrame", descriptors!("pose"));
pub const SHAPES: Topic = topic("/simulated/scene", "foxglove.SceneUpdate", descriptors!("scene"));
pub const TRANSFORMS: Topic =
    topic("/simulated/transforms", "foxglove.FrameTransforms", descriptors!("pose"));
pub const STATES: Topic = topic("/simulated/states", "vrdp.v1.TraceFrame", descriptors!("recording"));
pub const RESIDUALS: Topic =
    topic("/residual/positions", "vrdp.v1.TraceResiduals", descriptors!("recording"));
pub const EVENTS: Topic = topic("/events", "vrdp.v1.TraceEvent", descriptors!("recording"));
pub const LOG: Topic = topic("/log", "foxglove.Log", descriptors!("log"));

/// Every topic; messages of equal time stand in this order.
pub const TOPICS: [Topic; 9] =
    [PARAMETERS, MEASURED, POSES, SHAPES, TRANSFORMS, STATES, RESIDUALS, EVENTS, LOG];
