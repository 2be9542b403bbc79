//! A network in ONNX Runtime, whose library is loaded when it is first asked for.

use super::error::DetectorError;
use super::network::{Network, Tensor};
use ort::session::Session;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};
use std::path::Path;

/// The environment variable with the path of ONNX Runtime's library.
const LIBRARY: &str = "ORT_DYLIB_PATH";

/// A model with its session.
#[derive(Debug)]
pub(super) struct OnnxNetwork {
    session: Session,
    size: Option<[usize; 2]>,
}

impl OnnxNetwork {
    pub(super) fn open(path: &Path) -> Result<OnnxNetwork, DetectorError> {
        let usual = || format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
        let library = std::env::var(LIBRARY).ok().filter(|path| !path.is_empty()).unwrap_or_else(usual);
        let missing = |why: String| DetectorError::NoRuntime { why };
        let runtime = ort::init_from(library).map_err(|e| missing(e.to_string()))?;
        let runtime = runtime.with_telemetry(false).build().map_err(|e| missing(e.to_string()))?;
        let unread = |why: String| DetectorError::Model { why };
        let builder = Session::builder(&runtime).map_err(|e| unread(e.to_string()))?;
        let mut builder = builder.with_deterministic_compute(true).map_err(|e| unread(e.to_string()))?;
        let session = builder.commit_from_file(path).map_err(|e| unread(e.to_string()))?;
        let size = input_size(session.inputs())?;
        Ok(OnnxNetwork { session, size })
    }
}

/// Width and height of the one input, where they are fixed.
fn input_size(inputs: &[Outlet]) -> Result<Option<[usize; 2]>, DetectorError> {
    let wrong = |why: String| Err(DetectorError::Input { why });
    let [input] = inputs else {
        return wrong(format!("has {} inputs", inputs.len()));
    };
    let (name, kind) = (input.name(), input.dtype());
    let ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } = kind else {
        return wrong(format!("input {name:?} is {kind}"));
    };
    match shape[..] {
        [-1 | 1, -1 | 3, height, width] => {
            let side = |side: i64| usize::try_from(side).ok().filter(|side| *side > 0);
            Ok(side(width).zip(side(height)).map(|(width, height)| [width, height]))
        }
        _ => wrong(format!("input {name:?} is {kind}")),
    }
}

impl Network for OnnxNetwork {
    fn input_size(&self) -> Option<[usize; 2]> {
        self.size
    }

    fn output_names(&self) -> Vec<String> {
        self.session.outputs().iter().map(|output| output.name().to_string()).collect()
    }

    fn run(&mut self, image: Tensor, outputs: &[&str]) -> Result<Vec<Tensor>, DetectorError> {
        let size = [image.shape[3], image.shape[2]];
        let failed = |why: String| DetectorError::Run { why, size };
        let input = TensorRef::from_array_view((image.shape, image.values.as_slice()));
        let input = input.map_err(|e| failed(e.to_string()))?;
        let found = self.session.run(ort::inputs![input]).map_err(|e| failed(e.to_string()))?;
        let one = |name: &&str| {
            let value = found.get(name).ok_or_else(|| failed(format!("output {name:?} is missing")))?;
            let shape =
                |shape: &[i64]| shape.iter().map(|side| usize::try_from(*side).unwrap_or(0)).collect();
            if let Ok((sides, values)) = value.try_extract_tensor::<f32>() {
                return Ok(Tensor { shape: shape(sides), values: values.to_vec() });
            }
            if let Ok((sides, values)) = value.try_extract_tensor::<i64>() {
                return Ok(Tensor {
                    shape: shape(sides),
                    values: values.iter().map(|v| *v as f32).collect(),
                });
            }
            if let Ok((sides, values)) = value.try_extract_tensor::<i32>() {
                return Ok(Tensor {
                    shape: shape(sides),
                    values: values.iter().map(|v| *v as f32).collect(),
                });
            }
            Err(failed(format!("output {name:?} is {}, but floats or whole numbers are read", value.dtype())))
        };
        outputs.iter().map(one).collect()
    }
}
