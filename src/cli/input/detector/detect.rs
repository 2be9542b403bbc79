//! A video to the scene of what a network detects in its frames.

use super::contract::DetectorContract;
use super::error::DetectorError;
use super::network::{Network, input_size, planes};
use super::outputs::{FrameOutputs, OutputReader};
use crate::cli::error::Failure;
use crate::cli::input::files::bytes;
use crate::cli::input::videos::{VideoView, open};
use crate::cli::output::progress::TaskProgress;
use crate::media::Video;
use crate::num::never;
use crate::perception::{PerceptionError, PerceptionOptions, View, top_camera};
use crate::scene::{
    Camera, DEFAULT_SIZE, Detection, IMAGE_NOISE, IMAGE_NOISE_RANGE, LinkError, LinkOptions, LinkReport,
    MAX_DETECTIONS, MAX_IN_FRAME, Scene, decoded, link,
};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// The scene of a video in which a network detected the bodies.
pub struct DetectedVideo {
    pub scene: Scene,
    pub linking: LinkReport,
    format: String,
    model: String,
    /// Of computation (s).
    seconds: f64,
}

impl DetectedVideo {
    /// How its objects were found, as JSON.
    pub fn report_json(&self) -> Value {
        let LinkReport { frames, detections, objects, gaps_bridged, frames_bridged, detections_dropped } =
            self.linking;
        json!({
            "format": self.format,
            "detector": self.model,
            "frames": frames,
            "detections": detections,
            "objects": objects,
            "gaps_bridged": gaps_bridged,
            "frames_bridged": frames_bridged,
            "detections_dropped": detections_dropped,
            "seconds": self.seconds,
            "frames_per_second": frames as f64 / self.seconds.max(1e-9),
        })
    }

    /// One line: how much was detected.
    pub fn line(&self) -> String {
        format!(
            "{} frames of {}, {} detections by {}, {:.0} frames/s",
            self.linking.frames,
            self.format,
            self.linking.detections,
            self.model,
            self.linking.frames as f64 / self.seconds.max(1e-9)
        )
    }
}

/// Finds the objects of a video by the network in a file, and links them to tracks. `noise`: standard deviation of the edges of
/// detections (px).
pub fn detect(
    path: &Path,
    model: &Path,
    view: &VideoView,
    noise: Option<f64>,
) -> Result<DetectedVideo, Failure> {
    let start = Instant::now();
    let place = path.display().to_string();
    let model_place = format!("--detector {}", model.display());
    let at_model = |e: DetectorError| match e {
        #[cfg(not(feature = "onnx"))]
        DetectorError::NotBuilt => Failure::input(e.to_string()),
        e => Failure::input(e.to_string()).at(&model_place),
    };
    let mut network = network(model).map_err(at_model)?;
    let contract = contract(model)?;
    if view.args.background.is_some() {
        return Err(Failure::input("--background has no effect with --detector; leave it out"));
    }
    let sigma = noise.unwrap_or(IMAGE_NOISE);
    if !IMAGE_NOISE_RANGE.contains(&sigma) {
        let (low, high) = (IMAGE_NOISE_RANGE.start(), IMAGE_NOISE_RANGE.end());
        return Err(Failure::input(format!("--noise: is {sigma}; give {low} to {high} px")));
    }
    let video = open(path, view.args.decoder).map_err(|f| f.at(&place))?;
    let known = view.options(path)?;
    let camera = camera(&known, &video).map_err(|f| f.at(&place))?;
    let found = detections(&video, &contract, &mut *network).map_err(at_model)?;
    let options = LinkOptions {
        frames: video.info().times.len(),
        fps: video.info().fps.unwrap_or(25.0),
        camera,
        size: known.size.unwrap_or(DEFAULT_SIZE),
        sigma,
    };
    let (scene, linking) = linked(&found, &options, &video, known).map_err(|f| f.at(&place))?;
    let model = model.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let format = video.info().format.clone();
    Ok(DetectedVideo { scene, linking, format, model, seconds: start.elapsed().as_secs_f64() })
}

#[cfg(feature = "onnx")]
fn network(model: &Path) -> Result<Box<dyn Network>, DetectorError> {
    Ok(Box::new(super::onnx::OnnxNetwork::open(model)?))
}

#[cfg(not(feature = "onnx"))]
fn network(_: &Path) -> Result<Box<dyn Network>, DetectorError> {
    Err(DetectorError::NotBuilt)
}

/// The JSON beside a model, with the same stem.
fn contract(model: &Path) -> Result<DetectorContract, Failure> {
    let file = model.with_extension("json");
    let place = file.display().to_string();
    if !file.is_file() {
        let message = "is missing; write what the outputs of the model are, such as {\"output\": \"boxes\", \"names\": {\"boxes\": \"boxes\", \
                       \"scores\": \"scores\"}}";
        return Err(Failure::input(message).at(&place));
    }
    let text = decoded(&bytes(&file)?).map_err(|e| Failure::input(e.to_string()).at(&place))?;
    DetectorContract::parse(&text).map_err(|e| Failure::input(e.to_string()).at(&place))
}

/// The camera of the view, which must be that of the video's frames.
fn camera(known: &PerceptionOptions, video: &Video) -> Result<Camera, Failure> {
    let size = video.info().size;
    let found = match known.view {
        View::Calibrated(camera) => camera,
        View::Above { scale: Some(scale) } => top_camera(scale, size.map(|side| side as f64)),
        View::Above { scale: None } => {
            return Err(Failure::input(
                "--view top needs --scale METRES with --detector; give the size of a pixel",
            ));
        }
    };
    let camera = found.image_size.map(|side| side.round() as usize);
    match camera == size {
        true => Ok(found),
        false => {
            let error = PerceptionError::ImageSize { camera, video: size };
            Err(Failure::input(format!("{error} (--camera FILE)")))
        }
    }
}

/// The detections of all frames.
fn detections(
    video: &Video,
    contract: &DetectorContract,
    network: &mut dyn Network,
) -> Result<Vec<Detection>, DetectorError> {
    let input = input_size(contract, network, video)?;
    let names = contract.outputs();
    let mut reader = OutputReader { contract, input, video: video.info().size, frame: 0, length: None };
    let (progress, count) = (TaskProgress::new(1), video.info().times.len());
    let mut all: Vec<Detection> = vec![];
    for (k, frame) in video.frames().enumerate() {
        progress.show("running the detector", 0, k as f64 / count as f64);
        let frame = frame.map_err(|e| DetectorError::field("video", e.to_string()))?;
        let mut found = network.run(planes(frame, input), &names)?.into_iter();
        let mut next = |named: &Option<String>| named.as_ref().and_then(|_| found.next());
        let Some(regions) = next(&Some(String::new())) else { continue };
        let (scores, classes) = (next(&contract.scores), next(&contract.classes));
        let features = next(&contract.features);
        reader.frame = k;
        let own = reader.detections(&FrameOutputs { regions, scores, classes, features })?;
        let limit = match (own.len(), all.len() + own.len()) {
            (given, _) if given > MAX_IN_FRAME => Some(LinkError::Crowded { frame: k, given }),
            (_, given) if given > MAX_DETECTIONS => Some(LinkError::TooMany { given }),
            _ => None,
        };
        if let Some(error) = limit {
            let message = format!("lets too many detections pass: {error}; raise it");
            return Err(DetectorError::field("least_score", message));
        }
        all.extend(own);
    }
    Ok(all)
}

/// The scene of linked detections.
fn linked(
    found: &[Detection],
    options: &LinkOptions,
    video: &Video,
    known: PerceptionOptions,
) -> Result<(Scene, LinkReport), Failure> {
    let linked = link(found, options, &never).map_err(|e| Failure::input(e.to_string()))?;
    let scene = Scene {
        name: known.name,
        setup: None,
        world: known.world,
        fps: options.fps,
        times: video.info().times.clone(),
        camera: Some(linked.camera),
        table: known.table,
        noise_sigma: None,
        objects: linked.objects,
        tracks: linked.tracks,
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    };
    let scene = scene.validate().map_err(|e| Failure::input(e.to_string()))?;
    Ok((scene, linked.report))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::input::detector::network::Tensor;

    /// A network that sees a box around the reddest pixels.
    struct Reddest {
        size: Option<[usize; 2]>,
        seen: Vec<Vec<usize>>,
    }

    impl Network for Reddest {
        fn input_size(&self) -> Option<[usize; 2]> {
            self.size
        }

        fn output_names(&self) -> Vec<String> {
            ["boxes", "scores", "features"].map(String::from).to_vec()
        }

        fn run(&mut self, image: Tensor, outputs: &[&str]) -> Result<Vec<Tensor>, DetectorError> {
            let [_, _, height, width] = image.shape[..] else { panic!("{:?}", image.shape) };
            self.seen.push(image.shape);
            let [red, green, _] = [0, 1, 2].map(|c| &image.values[c * height * width..][..height * width]);
            let red: Vec<usize> = (0..red.len()).filter(|&p| red[p] - 2.0 * green[p] > 0.12).collect();
            let side = |of: fn(usize, usize) -> usize| {
                let of = red.iter().map(|&p| of(p, width));
                (of.clone().min().unwrap_or(0) as f32, of.max().map_or(0, |last| last + 1) as f32)
            };
            let ((left, right), (top, bottom)) = (side(|p, w| p % w), side(|p, w| p / w));
            let one = |name: &&str| match *name {
                "boxes" => Tensor { shape: vec![1, 4], values: vec![left, top, right, bottom] },
                "scores" => Tensor { shape: vec![1], values: vec![1.0] },
                _ => Tensor { shape: vec![1, 2], values: vec![right - left, bottom - top] },
            };
            Ok(outputs.iter().map(one).collect())
        }
    }

    #[test]
    fn a_network_of_any_kind_finds_the_objects_of_a_video() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/videos/scene_00011");
        let video = Video::open(std::fs::read(root.join("video.mp4")).unwrap()).unwrap();
        let camera = crate::cli::input::camera(&root.join("camera.json")).unwrap();
        let contract = |size: &str| {
            let names = r#"{"boxes": "boxes", "scores": "scores", "features": "features"}"#;
            let text = format!(r#"{{"output": "boxes", "names": {names}, "size": {size}}}"#);
            DetectorContract::parse(&text).unwrap()
        };
        let options = LinkOptions { frames: 128, fps: 25.0, camera, size: 0.2, sigma: 1.0 };
        for (size, fixed, expected) in [("null", None, [480, 320]), ("[240, 160]", None, [240, 160])] {
            let mut network = Reddest { size: fixed, seen: vec![] };
            let found = detections(&video, &contract(size), &mut network).unwrap();
            assert_eq!(network.seen, vec![vec![1, 3, expected[1], expected[0]]; 128]);
            let known = PerceptionOptions::of_view("red".into(), View::Calibrated(camera), None, None);
            let (scene, report) = linked(&found, &options, &video, known).unwrap();
            assert_eq!((scene.objects.len(), report.detections), (1, 128));
            assert_eq!(scene.times, video.info().times);
            // A ball of 36 px, that size in pixels of the input.
            let wide = 36.0 * expected[0] as f32 / 480.0;
            assert!(
                (scene.objects[0].features[0] - wide).abs() < 0.1 * wide,
                "{:?}",
                scene.objects[0].features
            );
        }
        let mut fixed = Reddest { size: Some([64, 64]), seen: vec![] };
        let said = detections(&video, &contract("[240, 160]"), &mut fixed).unwrap_err().to_string();
        assert!(
            said.starts_with("size: is [240, 160], but the input of the model has [64, 64] px"),
            "{said}"
        );
        let other = DetectorContract::parse(r#"{"output": "masks", "names": {"masks": "m"}}"#).unwrap();
        let said = detections(&video, &other, &mut fixed).unwrap_err().to_string();
        assert!(
            said.starts_with("names: the model has no output \"m\"; it has boxes, scores, features"),
            "{said}"
        );
    }
}
