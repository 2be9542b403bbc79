//! `simulate`: predicts how a scene continues, with or without interventions.

use crate::api::v1::intervention::{
    Kind, Remove, ScaleFriction, ScaleMass, ScaleRestitution, SetVelocity, Shift, SwitchEffect,
};
use crate::api::v1::{
    EventKind, GetModelRequest, Intervention, Model, SimulateRequest, SimulateResponse, SimulatedEvent,
    Vector,
};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::scene::Scene;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Smallest probability of an event in the table; JSON and traces have all events.
const LIKELY: f64 = 0.5;

#[derive(clap::Args)]
pub struct SimulateArgs {
    /// Scene file or scene folder.
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Removes an object.
    #[arg(long, value_name = "ID")]
    remove: Vec<u32>,
    /// Multiplies an object's mass.
    #[arg(long, value_name = "ID=FACTOR", value_parser = input::id_and_number)]
    mass: Vec<(u32, f64)>,
    /// Sets the start velocity of an object (m/s).
    #[arg(long, value_name = "ID=VX,VY", value_parser = input::id_and_vector, allow_hyphen_values = true)]
    velocity: Vec<(u32, [f64; 2])>,
    /// Moves the start position of an object (m).
    #[arg(long, value_name = "ID=DX,DY", value_parser = input::id_and_vector, allow_hyphen_values = true)]
    shift: Vec<(u32, [f64; 2])>,
    /// Multiplies the restitution of an object.
    #[arg(long, value_name = "ID=FACTOR", value_parser = input::id_and_number)]
    restitution: Vec<(u32, f64)>,
    /// Multiplies the friction between the ground and an object.
    #[arg(long, value_name = "ID=FACTOR", value_parser = input::id_and_number)]
    friction: Vec<(u32, f64)>,
    /// Switches an effect of the model off.
    #[arg(long, value_name = "EFFECT")]
    without: Vec<String>,
    /// Number of frames, from frame 0 [default: observed + 60].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Number of rollouts, each with parameters drawn from the posterior, 1 to 32 [default: 32]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32))]
    rollouts: Option<u32>,
    /// Seed of the draws; the same seed gives the same result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Preset, id of a kept model (`vrdp show`), or model file [default: by the scene's world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Writes the trace; else it is kept only with --data-dir or --server.
    #[arg(long, value_name = "FILE.mcap")]
    trace: Option<PathBuf>,
    /// The trace shows frames of the video too, with the outlines of the objects.
    #[arg(long)]
    stills: bool,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: SimulateArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    if let Some(file) = &args.trace {
        if file.as_os_str() == "-" {
            return Err(Failure::input("--trace -: a trace is binary; give a file"));
        }
        output::writable("--trace", file)?;
    }
    let scene = input::scene(&args.scene)?;
    let model = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let video = connection.post(&scene).await?;
    let model = connection.choice(&video, model.as_ref()).await?;
    let request = SimulateRequest {
        video,
        model,
        interventions: interventions(&args),
        frames: args.frames.unwrap_or(0),
        rollouts: args.rollouts,
        seed: args.seed,
        stills: args.stills,
        ..Default::default()
    };
    let reply = progress::during("simulating", connection.reasoning().simulate(request)).await;
    let reply = reply.map_err(|status| with_flags(status.into(), &flags(&args)))?.into_inner();
    let mut trace = connection.keeps_traces().then(|| reply.trace.clone());
    if let Some(path) = &args.trace {
        output::file(path, &connection.download(&reply.trace).await?)?;
        trace = Some(path.display().to_string());
    }
    let asked = GetModelRequest { name: reply.model.clone(), ..Default::default() };
    let model = connection.models().get_model(asked).await?.into_inner();
    let mut text = events(&scene, &reply.events) + &notes(&scene, &reply) + &misfit(&model);
    if let Some(trace) = &trace {
        text += &format!("\n  trace {trace}\n");
    }
    let place = [args.scene.clone()];
    text += &match &args.trace {
        Some(file) => output::next("trace", &[], &["info", &file.display().to_string()]),
        None if flags(&args).is_empty() => {
            let first = scene.objects.first().map_or(0, |o| o.id).to_string();
            output::next("simulate", &place, &["--remove", &first])
        }
        None => output::next("simulate", &place, &["--trace", "trace.mcap"]),
    };
    output::result(args.json.as_deref(), &text, || to_json(&scene, &reply, trace))?;
    connection.close().await
}

/// The flags of the interventions, in the order of the request.
fn flags(args: &SimulateArgs) -> Vec<String> {
    let number = |flag: &'static str| move |(id, v): &(u32, f64)| format!("{flag} {id}={v:?}");
    let vector =
        |flag: &'static str| move |(id, [x, y]): &(u32, [f64; 2])| format!("{flag} {id}={x:?},{y:?}");
    let remove = args.remove.iter().map(|id| format!("--remove {id}"));
    let mass = args.mass.iter().map(number("--mass"));
    let velocity = args.velocity.iter().map(vector("--velocity"));
    let shift = args.shift.iter().map(vector("--shift"));
    let restitution = args.restitution.iter().map(number("--restitution"));
    let friction = args.friction.iter().map(number("--friction"));
    let without = args.without.iter().map(|effect| format!("--without {effect}"));
    remove
        .chain(mass)
        .chain(velocity)
        .chain(shift)
        .chain(restitution)
        .chain(friction)
        .chain(without)
        .collect()
}

/// The failure with the user's flags in place of the request's fields, such as `interventions[0].scale_mass.factor`.
fn with_flags(failure: Failure, flags: &[String]) -> Failure {
    const FIELD: &str = "interventions";
    failure.map(|message| {
        let line = |line: &str| {
            let Some((before, after)) = line.split_once(FIELD) else { return line.to_string() };
            let index = after.strip_prefix('[').and_then(|rest| rest.split_once(']'));
            let flag = index.and_then(|(k, rest)| Some((flags.get(k.parse::<usize>().ok()?)?, rest)));
            match flag {
                Some((flag, rest)) => {
                    let rest =
                        rest.trim_start_matches(|c: char| c.is_ascii_lowercase() || c == '.' || c == '_');
                    format!("{before}{flag}{rest}")
                }
                None => format!("{before}{}", after.trim_start_matches([':', ' '])),
            }
        };
        message.lines().map(line).collect::<Vec<_>>().join("\n")
    })
}

fn interventions(args: &SimulateArgs) -> Vec<Intervention> {
    let remove = args.remove.iter().map(|&object_id| Kind::Remove(Remove { object_id }));
    let mass = args.mass.iter().map(|&(object_id, factor)| Kind::ScaleMass(ScaleMass { object_id, factor }));
    let velocity = args.velocity.iter().map(|&(object_id, [x, y])| {
        Kind::SetVelocity(SetVelocity { object_id, velocity: Some(Vector { x, y }) })
    });
    let shift = args
        .shift
        .iter()
        .map(|&(object_id, [x, y])| Kind::Shift(Shift { object_id, by: Some(Vector { x, y }) }));
    let restitution = args
        .restitution
        .iter()
        .map(|&(object_id, factor)| Kind::ScaleRestitution(ScaleRestitution { object_id, factor }));
    let friction = args
        .friction
        .iter()
        .map(|&(object_id, factor)| Kind::ScaleFriction(ScaleFriction { object_id, factor }));
    let without = args
        .without
        .iter()
        .map(|effect| Kind::SwitchEffect(SwitchEffect { effect: effect.clone(), on: false }));
    let edits =
        remove.chain(mass).chain(velocity).chain(shift).chain(restitution).chain(friction).chain(without);
    edits.map(|kind| Intervention { kind: Some(kind) }).collect()
}

fn word(event: &SimulatedEvent) -> &'static str {
    match event.kind() {
        EventKind::Collision => "collision",
        EventKind::Enter => "enter",
        EventKind::Exit => "exit",
        EventKind::Stop => "stop",
        EventKind::Unspecified => "unknown",
    }
}

/// The likely events as a table; those after the video are marked.
pub fn events(scene: &Scene, events: &[SimulatedEvent]) -> String {
    let likely: Vec<&SimulatedEvent> = events.iter().filter(|e| e.probability >= LIKELY).collect();
    let end = scene.times.len();
    let later = |event: &SimulatedEvent| event.frame as usize >= end;
    let rows: Vec<Vec<String>> = likely
        .iter()
        .map(|event| {
            let objects = event.object_ids.iter().map(|id| super::fit::name(scene, *id));
            let wall = (!event.wall.is_empty()).then(|| format!("wall {}", event.wall));
            let who: Vec<String> = objects.chain(wall).collect();
            vec![
                format!("{:<9}  {}", word(event), who.join(" and ")),
                format!("{}{}", event.frame, if later(event) { "*" } else { " " }),
                format!("{:.2} s", event.time),
                format!("{:.0} %", 100.0 * event.probability),
            ]
        })
        .collect();
    let mut text = output::table(&["event", "frame ", "time", "probability"], &rows);
    if likely.iter().any(|e| later(e)) {
        text += &format!("  * after the video, which has {end} frames\n");
    }
    match events.len() - likely.len() {
        0 => text,
        n => text + &format!("  {n} less likely events (below {:.0} %) are in --json\n", 100.0 * LIKELY),
    }
}

/// Notes under the table of events.
fn notes(scene: &Scene, reply: &SimulateResponse) -> String {
    let mut notes = String::new();
    let unreached = reply.unreached_object_ids.iter().map(|id| super::fit::name(scene, *id));
    let unreached: Vec<String> = unreached.collect();
    if !unreached.is_empty() {
        notes += &format!(
            "  the change does not reach these objects; they move as observed: {}\n",
            unreached.join(", ")
        );
    }
    notes += &super::fit::pushes(&reply.unseen_pushes, ": here too, as it happened in the video");
    if let Some(cut) = &reply.cut_short {
        let shown = cut.frame.map_or(String::new(), |f| format!(", the shown one at frame {f}"));
        notes +=
            &format!("  {} simulations of the ensemble ended early{shown}: {}\n", cut.rollouts, cut.message);
    }
    notes
}

/// A warning if the model does not fit the video: its probabilities are then too certain.
fn misfit(model: &Model) -> String {
    match model.adequate {
        true => String::new(),
        false => format!(
            "  the model does not fit the video (reduced chi-square {:.1}), so its probabilities are too certain; run `vrdp compare` or `vrdp discover`\n",
            model.reduced_chi_square
        ),
    }
}

fn to_json(scene: &Scene, reply: &SimulateResponse, trace: Option<String>) -> Value {
    let frames: Vec<Value> = reply
        .frames
        .iter()
        .map(|frame| {
            let objects: Vec<Value> = frame
                .objects
                .iter()
                .map(|o| {
                    json!({
                        "object_id": o.object_id, "x": o.x, "y": o.y, "yaw": o.yaw,
                        "vx": o.vx, "vy": o.vy, "spin": o.spin, "sd_m": o.sd,
                    })
                })
                .collect();
            json!({ "frame": frame.frame, "objects": objects })
        })
        .collect();
    let events: Vec<Value> = reply
        .events
        .iter()
        .map(|e| {
            json!({
                "kind": word(e), "frame": e.frame, "time_s": e.time,
                "object_ids": e.object_ids, "probability": e.probability,
            })
        })
        .collect();
    let cut_short = reply.cut_short.as_ref();
    json!({
        "scene": scene.name,
        "fps": reply.fps,
        "observed_frames": reply.observed_frames,
        "frames": frames,
        "events": events,
        "trace": trace,
        "unreached": reply.unreached_object_ids,
        "unseen_pushes": super::fit::pushes_json(&reply.unseen_pushes),
        "cut_short": cut_short.map(|c| json!({ "rollouts": c.rollouts, "frame": c.frame, "message": c.message })),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_the_flag_and_not_the_field_of_the_request() {
        let flags = ["--remove 1".to_string(), "--mass 3=1e300".to_string()];
        let shown = |message: &str| with_flags(Failure::input(message), &flags).to_string();
        let range = "interventions[1].scale_mass.factor: is 1e300; must be from 1e-9 to 1e9";
        assert_eq!(shown(range), "--mass 3=1e300: is 1e300; must be from 1e-9 to 1e9");
        assert_eq!(shown("interventions: object 9 is not in the model"), "object 9 is not in the model");
        assert_eq!(shown("frames: is 0"), "frames: is 0");
    }

    #[test]
    fn a_model_that_does_not_fit_the_video_gives_a_warning() {
        let model = Model { reduced_chi_square: 78.4, ..Default::default() };
        assert!(misfit(&model).contains("78.4"));
        assert_eq!(misfit(&Model { adequate: true, ..model }), "");
    }

    #[test]
    fn the_table_has_every_likely_event_and_marks_those_after_the_video() {
        const SCENE: &str = include_str!("../../../../tests/data/clevrer/scene_00022/observed.json");
        let scene = crate::scene::parse("scene_00022", SCENE).unwrap();
        let event = |frame: u32, probability| SimulatedEvent {
            kind: EventKind::Collision.into(),
            frame,
            time: f64::from(frame) / 25.0,
            object_ids: vec![0, 2],
            probability,
            wall: String::new(),
        };
        let all = [event(40, 1.0), event(90, 0.75), event(127, 0.2), event(128, 0.5)];
        insta::assert_snapshot!(events(&scene, &all), @r"
          event                                                frame     time  probability
          ────────────────────────────────────────────────────────────────────────────────
          collision  0 gray metal sphere and 2 red metal cube     40   1.60 s        100 %
          collision  0 gray metal sphere and 2 red metal cube     90   3.60 s         75 %
          collision  0 gray metal sphere and 2 red metal cube    128*  5.12 s         50 %
          * after the video, which has 128 frames
          1 less likely events (below 50 %) are in --json
        ");
    }
}
