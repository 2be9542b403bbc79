//! The command line: every command is a client of the service, in this process or remote.

mod ask;
mod calibrate;
mod compare;
mod connect;
mod demo;
mod diagnose;
mod discover;
mod effects;
mod error;
mod fit;
mod health;
mod import;
mod input;
mod ladder;
mod output;
mod progress;
mod replay;
mod report;
mod revise;
mod score;
mod serve;
mod simulate;
mod study;
mod trace;
mod wire;

use clap::{Parser, Subcommand};
use error::Failure;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "vrdp", version, about = "Understands the physics in a video.")]
struct Cli {
    #[command(flatten)]
    target: Target,
    #[command(subcommand)]
    command: Command,
}

/// Where the service is.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Options of all commands")]
struct Target {
    /// A running service, such as http://127.0.0.1:50051 [default: one inside this process]
    #[arg(long, global = true, value_name = "URL")]
    server: Option<String>,
    /// Folder of the store [default: a temporary folder; for `serve`: vrdp-data]
    #[arg(long, global = true, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Who signed the service's certificate (PEM) [default: whom this system trusts]
    #[arg(long, global = true, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// A certificate (PEM) by which the service knows us, with --key.
    #[arg(long, global = true, value_name = "FILE")]
    cert: Option<PathBuf>,
    /// The private key of --cert (PEM).
    #[arg(long, global = true, value_name = "FILE")]
    key: Option<PathBuf>,
    /// File with the token by which the service knows our tenant.
    #[arg(long, global = true, value_name = "FILE")]
    token: Option<PathBuf>,
    /// Shows no progress, only results.
    #[arg(long, short, global = true)]
    quiet: bool,
}

impl Target {
    /// Refuses what the command would not heed.
    fn check(&self, command: &Command) -> Result<(), Failure> {
        let known =
            [("--ca", &self.ca), ("--cert", &self.cert), ("--key", &self.key), ("--token", &self.token)];
        let known = known.iter().find(|(_, file)| file.is_some()).map(|(flag, _)| *flag);
        let remote = self.server.as_ref().map(|_| "--server").or(known);
        let folder = self.data_dir.as_ref().map(|_| "--data-dir");
        let useless = match command {
            Command::Serve(_) => remote,
            Command::Demo(_) | Command::Trace(_) | Command::Replay(_) => remote.or(folder),
            Command::Health => folder,
            _ if self.server.is_some() => folder,
            _ => None,
        };
        match (useless, known) {
            (Some("--data-dir"), _) if self.server.is_some() => {
                Err(Failure::input("--data-dir is this process's own store: leave it out with --server"))
            }
            (Some(flag), _) => {
                Err(Failure::input(format!("{flag} is of no use to this command: leave it out")))
            }
            (None, Some(flag)) if self.server.is_none() && !matches!(command, Command::Health) => {
                Err(Failure::input(format!("{flag} is for a service elsewhere: give its --server too")))
            }
            _ => Ok(()),
        }
    }
}

#[derive(Subcommand)]
enum Command {
    /// Runs the service until SIGTERM.
    Serve(serve::Args),
    /// Shows what it does on real scenes, over real gRPC.
    Demo(demo::Args),
    /// Fits a model to each scene.
    Fit(fit::Args),
    /// Predicts, or imagines what would have been.
    Simulate(simulate::Args),
    /// Answers a question about a scene.
    Ask(ask::Args),
    /// Residuals of each scene's model, and where it fails.
    Compare(compare::Args),
    /// Ranked candidates for the effect that a set-up's model lacks.
    Diagnose(diagnose::Args),
    /// Finds the missing effects of a set-up, adds them, and shows the error fall.
    Discover(discover::Args),
    /// One page with pictures: where the model fails, what was missing, and how far the error falls.
    Report(report::Args),
    /// Estimates a camera from points known in the image and in the world.
    Calibrate(calibrate::Args),
    /// Turns files of others into scenes.
    Import(import::Args),
    /// Puts an effect or a law of your own into a set-up's model, or takes one out; keeps the history.
    Revise(revise::Args),
    /// The catalogue of physical effects.
    Effects(effects::Args),
    /// Answers every question beside each scene, and tells how many answers are right.
    Score(score::Args),
    /// What is in a trace file, whether it is whole, and its numbers as CSV.
    Trace(trace::Args),
    /// Plays a trace file, or simulates it again and compares bit for bit.
    Replay(replay::Args),
    /// Whether a service is serving (exit status 0 or 1).
    Health,
}

/// What a shell says of a program that was interrupted.
const INTERRUPTED: u8 = 130;

/// Parses the arguments and runs the command: 0 done, 2 bad input or usage, 130 interrupted, 1 anything else.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    if cli.target.quiet {
        progress::silence();
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => {
            output::tell(&format!("error: {error}"));
            return ExitCode::from(1);
        }
    };
    // These two end in their own way.
    let ends_itself = matches!(cli.command, Command::Serve(_) | Command::Replay(_));
    let done = runtime.block_on(async {
        tokio::select! {
            done = run(cli) => Some(done),
            // What is dropped then deletes its temporary store.
            _ = serve::interrupted(), if !ends_itself => None,
        }
    });
    // Work that nobody waits for any more does not keep the program.
    runtime.shutdown_background();
    match done {
        Some(Ok(())) => ExitCode::SUCCESS,
        Some(Err(failure)) => {
            output::tell(&format!("error: {failure}"));
            ExitCode::from(failure.status())
        }
        None => {
            output::tell("interrupted");
            ExitCode::from(INTERRUPTED)
        }
    }
}

async fn run(cli: Cli) -> Result<(), Failure> {
    cli.target.check(&cli.command)?;
    match cli.command {
        Command::Serve(args) => serve::run(&cli.target, args).await,
        Command::Demo(args) => demo::run(args).await,
        Command::Fit(args) => fit::run(&cli.target, args).await,
        Command::Simulate(args) => simulate::run(&cli.target, args).await,
        Command::Ask(args) => ask::run(&cli.target, args).await,
        Command::Compare(args) => compare::run(&cli.target, args).await,
        Command::Diagnose(args) => diagnose::run(&cli.target, args).await,
        Command::Discover(args) => discover::run(&cli.target, args).await,
        Command::Report(args) => report::run(&cli.target, args).await,
        Command::Calibrate(args) => calibrate::run(&cli.target, args).await,
        Command::Import(args) => import::run(&cli.target, args).await,
        Command::Revise(args) => revise::run(&cli.target, args).await,
        Command::Effects(args) => effects::run(&cli.target, args).await,
        Command::Score(args) => score::run(&cli.target, args).await,
        Command::Trace(args) => trace::run(args),
        Command::Replay(args) => replay::run(args).await,
        Command::Health => health::run(&cli.target).await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn what_a_command_would_not_heed_is_refused() {
        let refused = |line: &str| match Cli::try_parse_from(line.split(' ')) {
            Ok(cli) => cli.target.check(&cli.command).err().map(|failure| failure.to_string()),
            Err(error) => Some(error.to_string()),
        };
        for fine in [
            "vrdp effects",
            "vrdp effects --data-dir d",
            "vrdp health --ca c",
            "vrdp serve --data-dir d",
            "vrdp effects --server u --token t",
            "vrdp --server u effects --token t",
            "vrdp discover s --frames 9 --json -",
        ] {
            assert_eq!(refused(fine), None, "{fine}");
        }
        for (line, named) in [
            ("vrdp effects --server u --data-dir d", "--data-dir"),
            ("vrdp effects --token t", "--server"),
            ("vrdp serve --server u", "--server"),
            ("vrdp replay f --data-dir d", "--data-dir"),
            ("vrdp health --data-dir d", "--data-dir"),
            ("vrdp discover s --frames 9", "--json"),
            ("vrdp replay f --verify --loop", "--loop"),
        ] {
            assert!(refused(line).is_some_and(|told| told.contains(named)), "{line}");
        }
    }
}
