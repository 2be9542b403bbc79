//! `demo`: shows the way from a video to answers on a real scene, over real gRPC.

use super::connect::Connection;
use super::error::Failure;
use super::{Target, ask, discover, fit, ladder, output, report, revise, simulate, study};
use crate::api::v1::add_effect_request::Addition;
use crate::api::v1::{
    AskResponse, DiscoverEffectsRequest, FitMethod, Formula, Revision, SimulateRequest, StudyRequest,
    WriteReportRequest,
};
use crate::scene::parse;
use std::path::{Path, PathBuf};

/// A scene that the Bullet engine simulated, as CLEVRER does; it works wherever the program is.
const SCENE: &str = include_str!("../../tests/data/clevrer/scene_00022/observed.json");
const PREDICTIVE: (&str, &[&str]) = (
    "What will happen next?",
    &["The red object collides with the sphere", "The gray metal cube and the metal sphere collide"],
);
const COUNTERFACTUAL: (&str, &[&str]) =
    ("What will happen if the gray cube is removed?", &["The red object collides with the sphere"]);

/// Four Bullet videos of one set-up, in which something acts that the model does not know.
const SET_UP: [&str; 4] = [
    include_str!("../../tests/data/effects/bullet_coriolis_medium/scene_00/observed.json"),
    include_str!("../../tests/data/effects/bullet_coriolis_medium/scene_01/observed.json"),
    include_str!("../../tests/data/effects/bullet_coriolis_medium/scene_02/observed.json"),
    include_str!("../../tests/data/effects/bullet_coriolis_medium/scene_03/observed.json"),
];

/// What hides there, as a user may write it: Coriolis acceleration in a frame that turns.
const TURNING_TABLE: &str = "let w [rad/s] = 0 from -5 to 5; ax = 2*w*vy; ay = -2*w*vx";

#[derive(clap::Args)]
pub struct Args {
    /// Where the traces and the drawing go.
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
}

pub async fn run(args: Args) -> Result<(), Failure> {
    let place = args.out.display().to_string();
    std::fs::create_dir_all(&args.out).map_err(|e| Failure::other(e).at(&place))?;
    let scene = parse("scene_00022", SCENE).map_err(Failure::other)?;
    let connection = Connection::open(&Target::default()).await?;
    if let Some(address) = connection.address() {
        output::print(&format!("vrdp serves gRPC on {address}\n\n"))?;
    }
    let video = connection.post(&scene).await?;
    let model = connection.fit(&video, None, FitMethod::Unspecified, |_| {}).await?;
    let seen = format!("1  Fit: {} objects, {} frames", scene.objects.len(), scene.times.len());
    let table = fit::table(&model, |id| fit::name(&scene, id));
    output::print(&format!("{seen} (in brackets: the data do not determine it)\n\n{table}\n"))?;

    let request = SimulateRequest { video: video.clone(), ..Default::default() };
    let mut reply = connection.reasoning().simulate(request).await?.into_inner();
    let end = reply.observed_frames;
    reply.events.retain(|event| event.frame >= end);
    let events = simulate::events(&scene, &reply.events);
    output::print(&format!("2  Predict: what comes after the video ends\n\n{events}\n"))?;
    let mut traces = vec![save(&connection, &reply.trace, &args.out, "prediction.mcap").await?];

    for (number, file, (question, choices)) in
        [(3, "predictive", PREDICTIVE), (4, "counterfactual", COUNTERFACTUAL)]
    {
        let request = ask::request(video.clone(), question, choices);
        let mut answer: AskResponse = connection.reasoning().ask(request).await?.into_inner();
        // One trail shows how it works; the others are alike.
        answer.choices.iter_mut().skip(1).for_each(|choice| choice.derivation.clear());
        output::print(&format!("{number}  Ask: {question}\n\n{}\n", ask::text(&answer)))?;
        for (i, trace) in answer.traces.iter().enumerate() {
            traces.push(save(&connection, trace, &args.out, &format!("{file}_{}.mcap", i + 1)).await?);
        }
    }
    let mut scenes = vec![];
    for (k, text) in SET_UP.iter().enumerate() {
        scenes.push(parse(&format!("set_up_{k}"), text).map_err(Failure::other)?);
    }
    let study = study::request(&connection, &scenes, None).await?;
    let videos = study.videos.clone();
    let shown = WriteReportRequest {
        study: Some(study.clone()),
        questions: vec![ask::request(video, COUNTERFACTUAL.0, COUNTERFACTUAL.1)],
        trace_prefix: "traces/".into(),
        ..Default::default()
    };
    let request = DiscoverEffectsRequest { study: Some(study), ..Default::default() };
    let found = discover::search(&connection, request).await?;
    output::print(&format!(
        "5  Discover: four videos of another set-up, in which something hides\n\n{}\n{}\n",
        discover::text(&found),
        discover::curve(&found)
    ))?;
    let first = found.revisions.first().map(|r| r.models.clone()).unwrap_or_default();
    let law = Formula { name: "turning_table".into(), text: TURNING_TABLE.into(), parameters: vec![] };
    let study = StudyRequest { videos, start: None, models: first };
    let revised = revise::add(&connection, study, Addition::Formula(law)).await?;
    output::print(&format!(
        "6  Add: the same law as you would write it yourself, {TURNING_TABLE}\n\n{}\n",
        revise::text(&revised, &found.revisions, &[], false)
    ))?;
    let drawing = args.out.join("revisions.svg");
    let drawn: Vec<&Revision> = found.revisions.iter().chain(&revised.after).collect();
    let title = "Error of each revision of the model";
    output::file(&drawing, ladder::svg(title, &drawn, found.noise_sigma).as_bytes())?;
    output::print(&format!("Drawing: {}\n", drawing.display()))?;
    let page = report::write(&connection, shown).await?;
    let (file, svg, linked) =
        (args.out.join("report.html"), args.out.join("pictures"), args.out.join("traces"));
    let said = report::save(&connection, &page, &file, Some(&svg), Some(&linked)).await?;
    output::print(&format!("\n7  See it: open the report in a browser\n\n{said}\n\n"))?;
    let traces: String = traces.iter().map(|path| format!("  {}\n", path.display())).collect();
    output::print(&format!("Traces (open them in Foxglove or Rerun):\n{traces}"))?;
    connection.close().await
}

async fn save(connection: &Connection, trace: &str, out: &Path, file: &str) -> Result<PathBuf, Failure> {
    let path = out.join(file);
    output::file(&path, &connection.download(trace).await?)?;
    Ok(path)
}
