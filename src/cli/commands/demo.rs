//! `demo`: runs all steps on a built-in video and built-in scenes: see, fit, predict, answer, find a hidden effect, write a report.

use super::scene::{ask, fit, simulate};
use super::study::{discover, report, revise};
use crate::api::v1::add_effect_request::Addition;
use crate::api::v1::{
    DiscoverEffectsRequest, Discovery, FitMethod, Formula, RevisedModels, Revision, SimulateRequest,
    StudyRequest, WriteReportRequest,
};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::{TaskProgress, during};
use crate::cli::output::revisions;
use crate::cli::{input, output};
use crate::scene::{Scene, parse};
use std::path::{Path, PathBuf};

/// A scene that the Bullet engine simulated, as in CLEVRER; it is part of the program.
const SCENE: &str = include_str!("../../../tests/data/clevrer/scene_00022/observed.json");
const PREDICTIVE: (&str, &[&str]) = (
    "What will happen next?",
    &["The red object collides with the sphere", "The gray metal cube and the metal sphere collide"],
);
const COUNTERFACTUAL: (&str, &[&str]) =
    ("What will happen if the gray cube is removed?", &["The red object collides with the sphere"]);

/// A video of two objects with its camera; it is part of the program.
const SEEN_VIDEO: &[u8] = include_bytes!("../../../tests/data/videos/scene_00011/video.mp4");
const CAMERA: &str = include_str!("../../../tests/data/videos/scene_00011/camera.json");

/// Four Bullet videos of one set-up with an effect that the model lacks.
const SET_UP: [&str; 4] = [
    include_str!("../../../tests/data/effects/bullet_coriolis_medium/scene_00/observed.json"),
    include_str!("../../../tests/data/effects/bullet_coriolis_medium/scene_01/observed.json"),
    include_str!("../../../tests/data/effects/bullet_coriolis_medium/scene_02/observed.json"),
    include_str!("../../../tests/data/effects/bullet_coriolis_medium/scene_03/observed.json"),
];

/// The hidden effect as a user may write it: Coriolis acceleration in a rotating frame.
const TURNING_TABLE: &str = "let w [rad/s] = 0 from -5 to 5; ax = 2*w*vy; ay = -2*w*vx";

#[derive(clap::Args)]
pub struct DemoArgs {
    /// Folder for the report, the traces and the drawing.
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
}

pub async fn run(args: DemoArgs) -> Result<(), Failure> {
    let folder = args.out.display().to_string();
    std::fs::create_dir_all(&args.out)
        .map_err(|e| Failure::input(format!("--out {folder}: {e}; give a folder that can be created")))?;
    let scene = parse("scene_00022", SCENE).map_err(Failure::other)?;
    let connection = Connection::open(&Target::default()).await?;
    if let Some(address) = connection.address() {
        output::print(&format!("The demo starts a service at {address} and calls it over gRPC.\n\n"))?;
    }
    see(&args.out)?;
    let video = connection.post(&scene).await?;
    let mut demo = Demo { connection, out: args.out, traces: vec![] };
    demo.fit(&scene, &video).await?;
    demo.predict(&scene, &video).await?;
    demo.ask(&video, 4, "predictive", PREDICTIVE).await?;
    demo.ask(&video, 5, "counterfactual", COUNTERFACTUAL).await?;
    let study = demo.study().await?;
    let found = demo.discover(study.clone()).await?;
    let revised = demo.add(&study, &found).await?;
    let places = demo.report(study, video).await?;
    demo.finish(&found, &revised, &places).await
}

/// Finds the objects of the built-in video; it is left in the folder, for the user's own trials.
fn see(out: &Path) -> Result<(), Failure> {
    announce(1, "See: finds the objects in a video, and follows them.")?;
    let folder = out.join("video");
    std::fs::create_dir_all(&folder).map_err(|e| Failure::other(format!("{}: {e}", folder.display())))?;
    let file = folder.join("video.mp4");
    output::file(&file, SEEN_VIDEO)?;
    output::file(&folder.join("camera.json"), CAMERA.as_bytes())?;
    let seen = input::see(&file, &input::VideoView::default())?;
    let lines: String = seen
        .scene
        .objects
        .iter()
        .zip(&seen.scene.tracks)
        .map(|(object, track)| {
            format!("  {}: seen in {} frames\n", object.description(), track.samples.len())
        })
        .collect();
    output::print(&format!("  {}: {}\n{lines}\n", file.display(), seen.line()))
}

/// The service, and what the steps leave behind.
struct Demo {
    connection: Connection,
    out: PathBuf,
    traces: Vec<PathBuf>,
}

/// Announces a step before its work starts.
fn announce(number: u32, step: &str) -> Result<(), Failure> {
    output::print(&format!("{number}  {step}\n\n"))
}

impl Demo {
    async fn fit(&self, scene: &Scene, video: &str) -> Result<(), Failure> {
        let (objects, frames) = (scene.objects.len(), scene.times.len());
        announce(
            2,
            &format!("Fit: estimates the physics of a video of {objects} objects and {frames} frames."),
        )?;
        let bar = TaskProgress::new(1);
        let progress = |fraction| bar.show("fitting", 0, fraction);
        let model = self.connection.fit(video, None, FitMethod::Unspecified, progress).await?;
        drop(bar);
        let table = fit::table(&model, |id| fit::name(scene, id));
        output::print(&format!("{table}  (in parentheses: the video does not determine the value)\n\n"))
    }

    async fn predict(&mut self, scene: &Scene, video: &str) -> Result<(), Failure> {
        announce(3, "Predict: simulates what happens after the video ends.")?;
        let request = SimulateRequest { video: video.into(), ..Default::default() };
        let reply = during("simulating", self.connection.reasoning().simulate(request)).await?;
        let mut reply = reply.into_inner();
        let end = reply.observed_frames;
        reply.events.retain(|event| event.frame >= end);
        output::print(&format!("{}\n", simulate::events(scene, &reply.events)))?;
        self.save(&reply.trace, "prediction.mcap").await
    }

    async fn ask(
        &mut self,
        video: &str,
        number: u32,
        file: &str,
        (question, choices): (&str, &[&str]),
    ) -> Result<(), Failure> {
        announce(number, &format!("Ask: answers a {file} question. {question}"))?;
        let request = ask::request(video.into(), question, choices);
        let mut answer = during("answering", self.connection.reasoning().ask(request)).await?.into_inner();
        // One derivation is enough as an example.
        answer.choices.iter_mut().skip(1).for_each(|choice| choice.derivation.clear());
        output::print(&format!("{}\n", ask::text(&answer)))?;
        for (i, trace) in answer.traces.iter().enumerate() {
            self.save(trace, &format!("{file}_{}.mcap", i + 1)).await?;
        }
        Ok(())
    }

    /// Posts the videos of the set-up with the hidden effect.
    async fn study(&self) -> Result<StudyRequest, Failure> {
        let mut scenes = vec![];
        for (k, text) in SET_UP.iter().enumerate() {
            scenes.push(parse(&format!("set_up_{k}"), text).map_err(Failure::other)?);
        }
        self.connection.study(&scenes, None).await
    }

    async fn discover(&self, study: StudyRequest) -> Result<Discovery, Failure> {
        announce(6, "Discover: finds the effect that the model lacks, in four videos of another set-up.")?;
        let request = DiscoverEffectsRequest { study: Some(study), ..Default::default() };
        let found = discover::search(&self.connection, request).await?;
        output::print(&format!("{}\n{}\n", discover::text(&found), discover::curve(&found)))?;
        Ok(found)
    }

    async fn add(&self, study: &StudyRequest, found: &Discovery) -> Result<RevisedModels, Failure> {
        announce(
            7,
            &format!(
                "Add: adds the same effect to the first model, as a formula of your own: {TURNING_TABLE}"
            ),
        )?;
        let models = found.revisions.first().map(|r| r.models.clone()).unwrap_or_default();
        let formula =
            Formula { name: "turning_table".into(), text: TURNING_TABLE.into(), parameters: vec![] };
        let study = StudyRequest { videos: study.videos.clone(), start: None, models };
        let revised = revise::add(&self.connection, study, Addition::Formula(formula)).await?;
        output::print(&format!("{}\n", revise::text(&revised, &found.revisions, &[], false)))?;
        Ok(revised)
    }

    /// Writes the report; returns lines that say where.
    async fn report(&self, study: StudyRequest, video: String) -> Result<String, Failure> {
        announce(8, "Report: writes one HTML page with pictures of all this.")?;
        let request = WriteReportRequest {
            study: Some(study),
            questions: vec![ask::request(video, COUNTERFACTUAL.0, COUNTERFACTUAL.1)],
            trace_prefix: "traces/".into(),
            ..Default::default()
        };
        let page = report::write(&self.connection, request).await?;
        let [svg, traces] = ["pictures", "traces"].map(|folder| self.out.join(folder));
        report::save(&self.connection, &page, &self.out.join("report.html"), Some(&svg), Some(&traces)).await
    }

    /// Draws the revisions, says where all files are, and stops the service.
    async fn finish(self, found: &Discovery, revised: &RevisedModels, places: &str) -> Result<(), Failure> {
        let drawing = self.out.join("revisions.svg");
        let drawn: Vec<&Revision> = found.revisions.iter().chain(&revised.after).collect();
        let svg = revisions::svg("Error of each revision of the model", &drawn, found.noise_sigma);
        output::file(&drawing, svg.as_bytes())?;
        let traces: String = self.traces.iter().map(|path| format!("  {}\n", path.display())).collect();
        output::print(&format!(
            "{places}\nDrawing of the errors: {}\nTraces of the answers, for Foxglove or Rerun:\n{traces}\nOpen {} in a browser.\n",
            drawing.display(),
            self.out.join("report.html").display()
        ))?;
        self.connection.close().await
    }

    /// Downloads a trace into the folder.
    async fn save(&mut self, trace: &str, file: &str) -> Result<(), Failure> {
        let path = self.out.join(file);
        output::file(&path, &self.connection.download(trace).await?)?;
        self.traces.push(path);
        Ok(())
    }
}
