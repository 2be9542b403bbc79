//! What a detector asks of a network, and a frame as its input.

use super::contract::DetectorContract;
use super::error::DetectorError;
use crate::media::{Video, VideoFrame};
use image::RgbImage;
use image::imageops::{FilterType, resize};

/// Several numbers in rows, planes and more, the last dimension first to change.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tensor {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// A network with an image as its one input.
pub(super) trait Network {
    /// Width and height of its input (px), where they are fixed.
    fn input_size(&self) -> Option<[usize; 2]>;
    /// Names of its outputs.
    fn output_names(&self) -> Vec<String>;
    /// These outputs for an image of 1 x 3 x height x width.
    fn run(&mut self, image: Tensor, outputs: &[&str]) -> Result<Vec<Tensor>, DetectorError>;
}

/// Width and height to which frames are brought: those that the contract states or the model fixes, else the video's. Refuses
/// a contract that contradicts the model.
pub(super) fn input_size(
    contract: &DetectorContract,
    network: &dyn Network,
    video: &Video,
) -> Result<[usize; 2], DetectorError> {
    let known = network.output_names();
    if let Some(missing) = contract.outputs().into_iter().find(|name| !known.iter().any(|k| k == name)) {
        let message = format!("the model has no output {missing:?}; it has {}", known.join(", "));
        return Err(DetectorError::field("names", message));
    }
    match (contract.size, network.input_size()) {
        (Some(stated), Some(fixed)) if stated != fixed => {
            let message = format!("is {stated:?}, but the input of the model has {fixed:?} px; leave it out");
            Err(DetectorError::field("size", message))
        }
        (stated, fixed) => Ok(stated.or(fixed).unwrap_or(video.info().size)),
    }
}

/// A frame of this width and height: red, green and blue planes from 0 to 1.
pub(super) fn planes(frame: VideoFrame, [width, height]: [usize; 2]) -> Tensor {
    let [own_width, own_height] = frame.size.map(|side| side as u32);
    let rgb = match frame.size == [width, height] {
        true => frame.rgb,
        false => RgbImage::from_raw(own_width, own_height, frame.rgb)
            .map(|image| resize(&image, width as u32, height as u32, FilterType::Triangle).into_raw())
            .unwrap_or_default(),
    };
    let plane =
        |c: usize| rgb.chunks_exact(3).map(move |pixel| f32::from(pixel[c]) / 255.0).collect::<Vec<_>>();
    Tensor { shape: vec![1, 3, height, width], values: [plane(0), plane(1), plane(2)].concat() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_becomes_planes_of_any_size() {
        let rgb = [[255, 0, 51], [255, 0, 51], [0, 255, 51], [0, 255, 51]].concat();
        let frame = VideoFrame { index: 0, time: 0.0, size: [2, 2], rgb };
        let same = planes(frame.clone(), [2, 2]);
        assert_eq!(same.shape, [1, 3, 2, 2]);
        assert_eq!(same.values, [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.2, 0.2, 0.2, 0.2]);
        let small = planes(frame, [1, 1]);
        assert_eq!(small.shape, [1, 3, 1, 1]);
        assert!(
            small.values[..2].iter().all(|v| (v - 0.5).abs() < 0.01) && small.values[2] == 0.2,
            "{small:?}"
        );
    }
}
