//! Why a detector is refused, and the cure.

/// Why a detector finds nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum DetectorError {
    #[cfg(not(feature = "onnx"))]
    #[error(
        "--detector is not part of this program; build it with `cargo build --release --features onnx`, and install ONNX Runtime \
         with `pip install onnxruntime`"
    )]
    NotBuilt,
    #[cfg(feature = "onnx")]
    #[error(
        "ONNX Runtime is not found: {why}; set ORT_DYLIB_PATH to its library, of version 1.17 or later: after `pip install \
         onnxruntime` it is onnxruntime/capi/libonnxruntime.so.* in the folder of Python's packages"
    )]
    NoRuntime { why: String },
    #[cfg(feature = "onnx")]
    #[error("is not read by ONNX Runtime: {why}; give an ONNX model")]
    Model { why: String },
    #[cfg(feature = "onnx")]
    #[error("{why}; give a model whose one input is an image of 1 x 3 x height x width in 32-bit floats")]
    Input { why: String },
    #[cfg(feature = "onnx")]
    #[error("the model fails: {why}; try it in Python on an image of {size:?} px (width, height)")]
    Run { why: String, size: [usize; 2] },
    #[error("frame {frame}: {output} {what}")]
    Output { frame: usize, output: String, what: String },
    #[error("{}", .0.iter().map(|(field, message)| format!("{field}: {message}")).collect::<Vec<_>>().join("\n"))]
    Fields(Vec<(String, String)>),
}

impl DetectorError {
    pub(super) fn field(field: &str, message: impl Into<String>) -> DetectorError {
        DetectorError::Fields(vec![(field.into(), message.into())])
    }
}
