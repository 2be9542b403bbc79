//! The outputs of a network for one frame, as detections.

use super::contract::{DetectorContract, Look, RegionOutput};
use super::error::DetectorError;
use super::network::Tensor;
use super::regions::{PixelRegion, connected, region};
use crate::num::elementary;
use crate::scene::{AttributeScores, BoundingBox, Detection, checked_features};

/// By how much a probability may exceed 1: sums of 32-bit floats round.
const ROUNDING: f64 = 1e-3;

/// The outputs of one frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FrameOutputs {
    pub regions: Tensor,
    pub scores: Option<Tensor>,
    pub classes: Option<Tensor>,
    pub features: Option<Tensor>,
}

/// Reads the outputs of the frames of one video.
pub(super) struct OutputReader<'a> {
    pub contract: &'a DetectorContract,
    /// Width and height of the network's input, and of the video (px).
    pub input: [usize; 2],
    pub video: [usize; 2],
    pub frame: usize,
    /// Number of features of the detections before.
    pub length: Option<usize>,
}

/// How likely each label is, by its index.
type LabelScores = Vec<(usize, f64)>;

/// A detection in the making: where it is, its score, and how likely each label is.
struct LabelledBox {
    bounds: BoundingBox,
    score: f64,
    labels: LabelScores,
    features: Vec<f32>,
}

impl OutputReader<'_> {
    pub(super) fn detections(&mut self, outputs: &FrameOutputs) -> Result<Vec<Detection>, DetectorError> {
        let contract = self.contract;
        let found = match &contract.regions {
            RegionOutput::Boxes { relative, .. } => self.boxes(outputs, *relative)?,
            RegionOutput::Masks { logits, least_pixels, .. } if contract.scores.is_some() => {
                self.instances(outputs, *logits, *least_pixels)?
            }
            RegionOutput::Masks { logits, least_pixels, .. } => self.maps(outputs, *logits, *least_pixels)?,
        };
        let mut detections = vec![];
        for one in found.into_iter().filter(|one| one.score >= contract.least_score) {
            if let Err(message) = checked_features(&one.features, &mut self.length) {
                return Err(self.wrong(contract.features.as_deref(), message));
            }
            detections.push(self.detection(one));
        }
        Ok(detections)
    }

    fn wrong(&self, output: Option<&str>, what: String) -> DetectorError {
        let output = output.map_or("an output".into(), |name| format!("output {name:?}"));
        DetectorError::Output { frame: self.frame, output, what }
    }

    fn detection(&self, one: LabelledBox) -> Detection {
        let words = |word: fn(&Look) -> &Option<String>| {
            let mut scores = AttributeScores::new();
            for (label, score) in &one.labels {
                if let Some(word) = self.contract.labels.get(*label).and_then(|look| word(look).clone()) {
                    *scores.entry(word).or_insert(0.0) += score;
                }
            }
            scores
        };
        let (color, material, shape) = (words(|l| &l.color), words(|l| &l.material), words(|l| &l.shape));
        let LabelledBox { bounds, score, features, .. } = one;
        Detection { frame: self.frame, bounds, color, material, shape, score, features }
    }

    /// Rectangles with their scores. Those outside the image are none.
    fn boxes(&self, outputs: &FrameOutputs, relative: bool) -> Result<Vec<LabelledBox>, DetectorError> {
        let name = Some(self.contract.regions.name());
        let (shape, values) = (&outputs.regions.shape, &outputs.regions.values);
        if shape.last() != Some(&4) || values.len() % 4 != 0 {
            return Err(self.wrong(name, format!("has the shape {shape:?}; give boxes as N x 4")));
        }
        let count = values.len() / 4;
        let judged = self.judged(outputs, count)?;
        let mut found = vec![];
        for (k, (corners, (score, labels))) in values.chunks_exact(4).zip(judged).enumerate() {
            if score < self.contract.least_score {
                continue;
            }
            if let Some(bad) = corners.iter().find(|v| !v.is_finite()) {
                return Err(self.wrong(name, format!("has {bad} in box {k}; give finite numbers")));
            }
            let unit = if relative { [1, 1] } else { self.input };
            let [left, top, right, bottom] = [0, 1, 2, 3].map(|c| {
                let size = self.video[c % 2] as f64;
                (f64::from(corners[c]) * size / unit[c % 2] as f64).clamp(0.0, size)
            });
            if left < right && top < bottom {
                let bounds = BoundingBox { left, top, right, bottom };
                let features = self.own_features(outputs, k, count)?;
                found.push(LabelledBox { bounds, score, labels, features });
            }
        }
        Ok(found)
    }

    /// A mask for each detection.
    fn instances(
        &self,
        outputs: &FrameOutputs,
        logits: bool,
        least: usize,
    ) -> Result<Vec<LabelledBox>, DetectorError> {
        let [height, width] = self.plane(&outputs.regions)?;
        let masks = outputs.regions.values.chunks_exact(height * width);
        let count = masks.len();
        let judged = self.judged(outputs, count)?;
        let mut found = vec![];
        for (k, (mask, (score, labels))) in masks.zip(judged).enumerate() {
            if score < self.contract.least_score {
                continue;
            }
            let on = (0..mask.len()).filter(|&p| probability(mask[p], logits) > 0.5).collect();
            if let Some(seen) = region(on, width).filter(|seen| seen.pixels.len() >= least) {
                let features = self.own_features(outputs, k, count)?;
                found.push(LabelledBox {
                    bounds: self.bounds(&seen, [width, height]),
                    score,
                    labels,
                    features,
                });
            }
        }
        Ok(found)
    }

    /// A map for each label; each of its connected regions is a body, with the mean probability of its pixels as score.
    fn maps(
        &self,
        outputs: &FrameOutputs,
        logits: bool,
        least: usize,
    ) -> Result<Vec<LabelledBox>, DetectorError> {
        let [height, width] = self.plane(&outputs.regions)?;
        let maps = outputs.regions.values.chunks_exact(height * width);
        let labels = self.contract.labels.len();
        if labels > 0 && labels != maps.len() {
            let what = format!("has {} maps for {labels} labels; give one for each label", maps.len());
            return Err(self.wrong(Some(self.contract.regions.name()), what));
        }
        let mut found = vec![];
        for (label, map) in maps.enumerate() {
            let mask: Vec<bool> = map.iter().map(|&v| probability(v, logits) > 0.5).collect();
            for seen in connected(&mask, width).into_iter().filter(|seen| seen.pixels.len() >= least) {
                let sum: f64 = seen.pixels.iter().map(|&p| probability(map[p], logits)).sum();
                let score = (sum / seen.pixels.len() as f64).min(1.0);
                let bounds = self.bounds(&seen, [width, height]);
                let features = self.mean_features(outputs, &seen, [height, width])?;
                found.push(LabelledBox { bounds, score, labels: vec![(label, 1.0)], features });
            }
        }
        Ok(found)
    }

    /// Height and width of the planes of an output.
    fn plane(&self, masks: &Tensor) -> Result<[usize; 2], DetectorError> {
        match masks.shape[..] {
            [.., height, width] if masks.shape.len() > 2 && height * width > 0 => Ok([height, width]),
            _ => {
                let what = format!("has the shape {:?}; give masks as 1 x K x height x width", masks.shape);
                Err(self.wrong(Some(self.contract.regions.name()), what))
            }
        }
    }

    /// The box around a region of a plane of this width and height, in pixels of the video.
    fn bounds(&self, seen: &PixelRegion, plane: [usize; 2]) -> BoundingBox {
        let [left, top, right, bottom] =
            [0, 1, 2, 3].map(|c| (seen.bounds[c] * self.video[c % 2]) as f64 / plane[c % 2] as f64);
        BoundingBox { left, top, right, bottom }
    }

    /// Score and labels of each detection: of one label each, or with a score for every label.
    fn judged(&self, outputs: &FrameOutputs, count: usize) -> Result<Vec<(f64, LabelScores)>, DetectorError> {
        let Some(scores) = &outputs.scores else { return Ok(vec![(1.0, vec![]); count]) };
        let name = self.contract.scores.as_deref();
        let known = self.contract.labels.len();
        if let Some(bad) = scores.values.iter().find(|s| !(0.0..=1.0 + ROUNDING).contains(&f64::from(**s))) {
            return Err(self.wrong(name, format!("has {bad}; give probabilities from 0 to 1")));
        }
        let values: Vec<f64> = scores.values.iter().map(|s| f64::from(*s).min(1.0)).collect();
        if values.len() == count {
            let classes = self.classes(outputs, count)?;
            let labels = |k: usize| classes.get(k).map(|label| (*label, 1.0)).into_iter().collect();
            return Ok(values.into_iter().enumerate().map(|(k, score)| (score, labels(k))).collect());
        }
        if known == 0 || values.len() != count * known {
            let what = format!(
                "has {} numbers for {count} detections and {known} labels; give one for each detection, or one for each label of each",
                values.len()
            );
            return Err(self.wrong(name, what));
        }
        let row = |row: &[f64]| {
            let labels = row.iter().copied().enumerate().filter(|(_, score)| *score > 0.0).collect();
            (row.iter().copied().fold(0.0, f64::max), labels)
        };
        Ok(values.chunks_exact(known).map(row).collect())
    }

    /// The index of the label of each detection; empty: without.
    fn classes(&self, outputs: &FrameOutputs, count: usize) -> Result<Vec<usize>, DetectorError> {
        let Some(classes) = &outputs.classes else { return Ok(vec![]) };
        let name = self.contract.classes.as_deref();
        let known = self.contract.labels.len();
        if classes.values.len() != count {
            let what =
                format!("has {} numbers for {count} detections; give one for each", classes.values.len());
            return Err(self.wrong(name, what));
        }
        let index = |value: &f32| {
            let label = (0..known).find(|k| *k as f32 == *value);
            label.ok_or_else(|| {
                self.wrong(name, format!("has the label {value}; labels in the JSON are 0 to {}", known - 1))
            })
        };
        classes.values.iter().map(index).collect()
    }

    /// Features of detection `k` of `count`, which have a row each.
    fn own_features(
        &self,
        outputs: &FrameOutputs,
        k: usize,
        count: usize,
    ) -> Result<Vec<f32>, DetectorError> {
        let Some(Tensor { shape, values }) = &outputs.features else { return Ok(vec![]) };
        if values.len() % count != 0 || values.len() != count * shape.last().copied().unwrap_or(0) {
            let what = format!("has the shape {shape:?}; give {count} x D, a row for each detection");
            return Err(self.wrong(self.contract.features.as_deref(), what));
        }
        let length = values.len() / count;
        Ok(values[k * length..][..length].to_vec())
    }

    /// Mean features of the pixels of a region, which have a plane each.
    fn mean_features(
        &self,
        outputs: &FrameOutputs,
        seen: &PixelRegion,
        plane: [usize; 2],
    ) -> Result<Vec<f32>, DetectorError> {
        let Some(Tensor { shape, values }) = &outputs.features else { return Ok(vec![]) };
        if !shape.ends_with(&plane) || shape.len() < 3 {
            let what = format!(
                "has the shape {shape:?}; give 1 x D x {} x {}, as the masks have",
                plane[0], plane[1]
            );
            return Err(self.wrong(self.contract.features.as_deref(), what));
        }
        let mean = |values: &[f32]| {
            let sum: f64 = seen.pixels.iter().map(|&p| f64::from(values[p])).sum();
            (sum / seen.pixels.len() as f64) as f32
        };
        Ok(values.chunks_exact(plane[0] * plane[1]).map(mean).collect())
    }
}

/// The probability that a pixel is of a body.
fn probability(value: f32, logits: bool) -> f64 {
    let value = f64::from(value);
    if logits { 1.0 / (1.0 + elementary::exp(-value)) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tensor(shape: &[usize], values: &[f32]) -> Tensor {
        Tensor { shape: shape.to_vec(), values: values.to_vec() }
    }

    fn read(contract: &DetectorContract, outputs: &FrameOutputs) -> Result<Vec<Detection>, String> {
        let mut reader = OutputReader { contract, input: [8, 4], video: [16, 8], frame: 7, length: None };
        reader.detections(outputs).map_err(|e| e.to_string())
    }

    fn contract(text: &str) -> DetectorContract {
        DetectorContract::parse(text).unwrap()
    }

    #[test]
    fn boxes_get_scores_words_and_features_in_pixels_of_the_video() {
        let mut own = contract(
            r#"{"output": "boxes", "names": {"boxes": "b", "scores": "s", "labels": "l", "features": "f"},
            "labels": [{"color": "red"}, {"shape": "cube", "material": "metal"}]}"#,
        );
        let boxes = tensor(&[1, 3, 4], &[1.0, 1.0, 3.0, 2.0, 0.0, 0.0, 1.0, 1.0, -1.0, 2.0, 9.0, 9.0]);
        let mut outputs = FrameOutputs {
            regions: boxes,
            scores: Some(tensor(&[1, 3], &[0.9, 0.1, 0.5])),
            classes: Some(tensor(&[3], &[1.0, 0.0, 0.0])),
            features: Some(tensor(&[3, 2], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])),
        };
        let found = read(&own, &outputs).unwrap();
        let edges: Vec<[f64; 4]> = found.iter().map(|d| d.bounds.edges()).collect();
        assert_eq!(edges, [[2.0, 2.0, 6.0, 4.0], [0.0, 4.0, 16.0, 8.0]]);
        assert!((found[0].score - 0.9).abs() < 1e-6 && found[0].frame == 7);
        assert_eq!(found[0].shape, AttributeScores::from([("cube".into(), 1.0)]));
        assert!(found[0].color.is_empty() && found[1].color.contains_key("red"));
        assert_eq!([&found[0].features[..], &found[1].features], [[1.0, 2.0], [5.0, 6.0]]);
        // A score for each label of each detection.
        (own.classes, outputs.classes) = (None, None);
        outputs.scores = Some(tensor(&[3, 2], &[0.25, 0.75, 0.0, 0.0, 0.5, 0.5]));
        let found = read(&own, &outputs).unwrap();
        assert_eq!((found[0].score, found[0].color["red"], found[0].shape["cube"]), (0.75, 0.25, 0.75));
    }

    #[test]
    fn what_is_wrong_with_an_output_is_named() {
        let own = contract(
            r#"{"output": "boxes", "names": {"boxes": "b", "scores": "s", "labels": "l", "features": "f"}, "labels": [{}]}"#,
        );
        let good = || FrameOutputs {
            regions: tensor(&[1, 4], &[0.0, 0.0, 1.0, 1.0]),
            scores: Some(tensor(&[1], &[0.9])),
            classes: Some(tensor(&[1], &[0.0])),
            features: Some(tensor(&[1, 2], &[1.0, 2.0])),
        };
        assert_eq!(read(&own, &good()).map(|found| found.len()), Ok(1));
        type Break = fn(&mut FrameOutputs);
        let cases: [(Break, &str); 8] = [
            (|o| o.regions.shape = vec![4, 1], "frame 7: output \"b\" has the shape [4, 1]; give boxes"),
            (|o| o.regions.values[2] = f32::NAN, "output \"b\" has NaN in box 0"),
            (|o| o.scores.as_mut().unwrap().values[0] = 3.0, "output \"s\" has 3; give probabilities"),
            (|o| o.scores.as_mut().unwrap().values.push(0.5), "output \"s\" has 2 numbers for 1 detections"),
            (
                |o| o.classes.as_mut().unwrap().values[0] = 1.0,
                "output \"l\" has the label 1; labels in the JSON are 0 to 0",
            ),
            (|o| o.classes.as_mut().unwrap().values.clear(), "output \"l\" has 0 numbers"),
            (|o| o.features.as_mut().unwrap().shape = vec![2, 1], "output \"f\" has the shape [2, 1]"),
            (|o| o.features.as_mut().unwrap().values[1] = f32::INFINITY, "output \"f\" number 1 is inf"),
        ];
        for (change, message) in cases {
            let mut outputs = good();
            change(&mut outputs);
            let said = read(&own, &outputs).unwrap_err();
            assert!(said.contains(message), "{said}");
        }
        let empty = FrameOutputs {
            regions: tensor(&[0, 4], &[]),
            scores: Some(tensor(&[0], &[])),
            classes: Some(tensor(&[0], &[])),
            features: Some(tensor(&[0, 2], &[])),
        };
        assert_eq!(read(&own, &empty), Ok(vec![]));
    }

    #[test]
    fn maps_are_split_into_bodies_and_masks_are_not() {
        let own = contract(
            r#"{"output": "masks", "names": {"masks": "m", "features": "f"}, "labels": [{"color": "red"}, {"color": "blue"}],
            "least_pixels": 2}"#,
        );
        // Two planes of 4 x 2: a body of two pixels and one of three with a speck between; nothing.
        let map = [9.0, -9.0, 9.0, -9.0, 9.0, -9.0, -9.0, 9.0].map(|v: f32| v);
        let [mut first, second] = [map, [-9.0; 8]];
        first[3] = 9.0;
        let planes = [first, second].concat();
        let features: Vec<f32> = (0..8).map(|p| p as f32).collect();
        let outputs = FrameOutputs {
            regions: tensor(&[1, 2, 2, 4], &planes),
            scores: None,
            classes: None,
            features: Some(tensor(&[1, 1, 2, 4], &features)),
        };
        let found = read(&own, &outputs).unwrap();
        let seen: Vec<([f64; 4], &[f32])> =
            found.iter().map(|d| (d.bounds.edges(), &d.features[..])).collect();
        assert_eq!(seen, [([0.0, 0.0, 4.0, 8.0], &[2.0][..]), ([8.0, 0.0, 16.0, 8.0], &[4.0][..])]);
        assert!(found[0].color.contains_key("red") && found[0].score > 0.99);
        // With scores each plane is one detection, of all its pixels.
        let own = contract(
            r#"{"output": "masks", "names": {"masks": "m", "scores": "s"}, "mask_values": "probabilities"}"#,
        );
        let (scores, features) = (Some(tensor(&[2], &[0.8, 0.9])), None);
        let found = read(&own, &FrameOutputs { scores, features, ..outputs.clone() }).unwrap();
        assert_eq!(found.iter().map(|d| d.bounds.edges()).collect::<Vec<_>>(), [[0.0, 0.0, 16.0, 8.0]]);
        let flat = FrameOutputs { regions: tensor(&[2, 8], &planes), ..outputs };
        assert!(read(&own, &flat).unwrap_err().contains("give masks as 1 x K x height x width"));
    }
}
