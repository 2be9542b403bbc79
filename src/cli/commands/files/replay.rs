//! `replay`: plays a trace file; with `--verify` simulates it again and compares bit for bit. It needs only the file.

use super::trace::{failure, open};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::cli::output::progress;
use crate::num::never;
use crate::recording::messages::{self as m, foxglove as fox};
use crate::recording::{MAX_TIME, TOLERANCE, TraceReader, Verification, build, verify};
use prost::Message as _;
use serde_json::json;
use std::fs::File;
use std::path::PathBuf;
use std::time::{Duration, Instant};

#[derive(clap::Args)]
pub struct ReplayArgs {
    /// Trace file.
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// Simulates again and compares bit for bit (exit status 0 or 1).
    #[arg(long, conflicts_with_all = ["speed", "from", "to", "again"])]
    verify: bool,
    /// Seconds of the trace per second; 0: as fast as possible.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Start time (s).
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    from: f64,
    /// End time (s) [default: the end of the trace].
    #[arg(long, value_name = "SECONDS")]
    to: Option<f64>,
    /// Repeats until ctrl-c.
    #[arg(long = "loop")]
    again: bool,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

fn speed(text: &str) -> Result<f64, String> {
    let factor: f64 = text.parse().map_err(|e| format!("{e}"))?;
    match factor == 0.0 || (0.001..=1000.0).contains(&factor) {
        true => Ok(factor),
        false => Err("give 0, or a factor from 0.001 to 1000".into()),
    }
}

pub async fn run(args: ReplayArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let to = args.to.unwrap_or(MAX_TIME);
    if !(0.0..=to).contains(&args.from) || to > MAX_TIME {
        let (from, most) = (args.from, MAX_TIME);
        return Err(Failure::input(format!(
            "--from {from} --to {to}: give times with 0 <= from <= to <= {most} s"
        )));
    }
    if args.again && args.speed == 0.0 {
        return Err(Failure::input("--loop needs a --speed above 0"));
    }
    // Both block their thread: one simulates, the other sleeps.
    let work = tokio::task::spawn_blocking(move || match args.verify {
        true => verify_again(&args),
        false => play(&args, to),
    });
    tokio::select! {
        done = work => done.map_err(|_| Failure::other("the trace cannot be simulated: its parts contradict each other; record it again"))?,
        stopped = tokio::signal::ctrl_c() => {
            stopped.map_err(Failure::other)?;
            // The playing thread may be asleep, so the program ends without it.
            std::process::exit(0)
        }
    }
}

fn verify_again(args: &ReplayArgs) -> Result<(), Failure> {
    let found = verify(open(&args.file)?, &never).map_err(|e| failure(&args.file, e))?;
    let value = || {
        let worst = found.worst.as_ref().map(|d| {
            json!({
                "topic": d.topic, "time_s": d.time, "what": d.what,
                "recorded": d.recorded, "again": d.recomputed,
            })
        });
        json!({
            "holds": found.holds(), "kind": found.kind, "build": found.build, "this_build": build(),
            "identical": found.identical, "messages": found.messages, "differing": found.differing,
            "unmatched": found.unmatched, "worst": worst, "tolerance": TOLERANCE,
            "origin_difference": found.origin_difference,
        })
    };
    output::result(args.json.as_deref(), &report(&found), value)?;
    match found.holds() {
        true => Ok(()),
        false => {
            Err(Failure::other(format!("{}: the replay differs from the recording", args.file.display())))
        }
    }
}

fn report(found: &Verification) -> String {
    let mut text = found.origin_difference.iter().map(|why| format!("{why}\n")).collect::<String>();
    if found.identical {
        return text + &format!("{}: {} messages, equal bit for bit\n", found.kind, found.messages);
    }
    if found.differing == 0 {
        let layout = "another program wrote the file";
        return text + &format!("{}: {} messages, equal bit for bit; {layout}\n", found.kind, found.messages);
    }
    text += &format!(
        "{}: {} messages, {} differ; {} of these are in one of the two only\n",
        found.kind, found.messages, found.differing, found.unmatched
    );
    if let Some(d) = &found.worst {
        text += &format!(
            "  largest difference: {} on {} at {} s: recorded {:?}, replayed {:?}\n",
            d.what, d.topic, d.time, d.recorded, d.recomputed
        );
    }
    text
}

fn play(args: &ReplayArgs, to: f64) -> Result<(), Failure> {
    let wrong = |e| failure(&args.file, e);
    let mut reader: TraceReader<File> = TraceReader::open(open(&args.file)?).map_err(wrong)?;
    let end = to.min(reader.span()[1]);
    let bar = progress::bar(((end - args.from).max(0.0) * 1e3).ceil() as u64, "{bar:40} {msg}");
    let topics = [&*m::STATES.name, &*m::AFTER.name, &*m::LOG.name];
    let (mut frames, mut events, mut rounds) = (0u64, 0u64, 0u64);
    loop {
        let start = Instant::now();
        for message in reader.messages(&topics, [args.from, to]) {
            let message = message.map_err(wrong)?;
            let since = message.time - args.from;
            if args.speed > 0.0 {
                let due = start + Duration::try_from_secs_f64(since / args.speed).unwrap_or(Duration::MAX);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            bar.set_position((since * 1e3) as u64);
            bar.set_message(format!("{:.2} of {end:.2} s", message.time));
            if *message.topic == *m::LOG.name {
                events += 1;
                let text = fox::Log::decode(message.data.as_slice()).unwrap_or_default().message;
                bar.suspend(|| match args.json.as_deref() {
                    Some("-") => Ok(()),
                    _ => output::print(&format!("{:8.3} s  {text}\n", message.time)),
                })?;
            } else {
                frames += 1;
            }
        }
        rounds += 1;
        if !args.again {
            break;
        }
    }
    bar.finish_and_clear();
    let text = format!("{frames} frames, {events} events\n");
    output::result(
        args.json.as_deref(),
        &text,
        || json!({ "frames": frames, "events": events, "rounds": rounds }),
    )
}
