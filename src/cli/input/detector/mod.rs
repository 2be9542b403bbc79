//! A user's own detector: a network finds bodies in single frames, and `scene::link` follows them.
//!
//! | file | job |
//! |---|---|
//! | `contract` | the JSON beside the model: what its outputs are |
//! | `network`, `error` | what a detector asks of a network, frames as its input; why a detector is refused |
//! | `onnx` | a network in ONNX Runtime, with the feature `onnx` |
//! | `outputs`, `regions` | boxes, scores and masks to detections; connected pixels of a mask |
//! | `detect` | a video to the scene of its linked detections |

mod contract;
mod detect;
mod error;
mod network;
#[cfg(feature = "onnx")]
mod onnx;
mod outputs;
mod regions;

pub use detect::detect;
