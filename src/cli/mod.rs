//! The command line: every command is a client of the service, in this process or remote.

mod commands;
mod connection;
mod error;
mod input;
mod output;
mod version;

use clap::{Parser, Subcommand};
use commands::demo;
use commands::files::{calibrate, convert, import, replay, trace};
use commands::scene::{ask, fit, parse, score, simulate};
use commands::service::{certs, data, effects, health, operations, serve};
use commands::study::{compare, diagnose, discover, report, revise, show};
use commands::words::{learn, show as words};
use connection::Target;
use error::Failure;
use output::progress;
use std::process::ExitCode;
use version::version;

/// Understands the physics in a video: fits, predicts, answers questions, and finds missing effects.
#[derive(Parser)]
#[command(name = "vrdp", disable_version_flag = true, arg_required_else_help = true)]
#[command(override_usage = "vrdp [OPTIONS] <COMMAND>")]
struct Cli {
    /// Prints the version; with --verbose also what else its numbers depend on.
    #[arg(long, short = 'V')]
    version: bool,
    /// With --version: adds the numeric fingerprint, the features and the target.
    #[arg(long, requires = "version")]
    verbose: bool,
    #[command(flatten)]
    target: Target,
    #[command(subcommand)]
    command: Option<Command>,
}

/// Refuses an option that has no effect on the command.
fn check(target: &Target, command: &Command) -> Result<(), Failure> {
    let credentials =
        [("--ca", &target.ca), ("--cert", &target.cert), ("--key", &target.key), ("--token", &target.token)];
    let credential = credentials.iter().find(|(_, file)| file.is_some()).map(|(flag, _)| *flag);
    let remote = target.server.as_ref().map(|_| "--server").or(credential);
    let folder = target.data_dir.as_ref().map(|_| "--data-dir");
    let threads = target.threads.map(|_| "--threads").filter(|_| match command {
        Command::Demo(_)
        | Command::Trace(_)
        | Command::Replay(_)
        | Command::Convert(_)
        | Command::Data(_)
        | Command::Certs(_)
        | Command::Health => true,
        _ => target.server.is_some(),
    });
    let unused = match command {
        Command::Serve(_) | Command::Data(_) => remote,
        Command::Certs(_) => remote.or(folder),
        Command::Demo(_) | Command::Trace(_) | Command::Replay(_) | Command::Convert(_) => remote.or(folder),
        Command::Health => folder,
        _ if target.server.is_some() => folder,
        _ => None,
    }
    .or(threads);
    match (unused, credential) {
        (Some("--data-dir"), _) if target.server.is_some() => {
            Err(Failure::input("--data-dir is the store of this process; with --server, leave it out"))
        }
        (Some(flag), _) => Err(Failure::input(format!("{flag} has no effect on this command; leave it out"))),
        (None, Some(flag)) if target.server.is_none() && !matches!(command, Command::Health) => {
            Err(Failure::input(format!("{flag} needs a remote service; name it with --server")))
        }
        _ => Ok(()),
    }
}

#[derive(Subcommand)]
enum Command {
    /// Runs the service until SIGTERM.
    Serve(serve::ServeArgs),
    /// Makes an authority and a certificate of a service, for trials.
    Certs(certs::CertsArgs),
    /// Runs all steps on real scenes: fit, predict, answer, find a hidden effect, write a report.
    Demo(demo::DemoArgs),
    /// Fits a model to each scene.
    Fit(fit::FitArgs),
    /// Predicts how a scene continues, or how it would with changes.
    Simulate(simulate::SimulateArgs),
    /// Answers a question about a scene.
    Ask(ask::AskArgs),
    /// Shows how a question is understood: its program, and that in English; lists the operations of programs.
    Parse(parse::ParseArgs),
    /// Compares each scene with its model: residuals, and where the model fails.
    Compare(compare::CompareArgs),
    /// Ranks the effects that the model of a set-up may lack.
    Diagnose(diagnose::DiagnoseArgs),
    /// Finds the missing effects of a set-up, adds them, and shows the errors before and after.
    Discover(discover::DiscoverArgs),
    /// Writes one HTML page: where the model fails, what was missing, the errors before and after.
    Report(report::ReportArgs),
    /// Estimates a camera from points whose image and world positions are known.
    Calibrate(calibrate::CalibrateArgs),
    /// Converts files of other programs and detections to scene files.
    Import(import::ImportArgs),
    /// Writes tables of other programs as CSV files of vrdp.
    Convert(convert::ConvertArgs),
    /// Adds an effect or a formula of your own to the model of a set-up, or removes one; keeps the history.
    Revise(revise::ReviseArgs),
    /// Shows the numbers of a fitted model with their uncertainty, to read or to cite; without an id lists all models.
    Show(show::ShowArgs),
    /// Lists long work on a service; shows it, waits for it, or cancels it.
    Operations(operations::OperationsArgs),
    /// Lists the physical effects.
    Effects(effects::EffectsArgs),
    /// Answers all questions of each scene and prints the accuracy.
    Score(score::ScoreArgs),
    /// Learns words from questions and answers, or one word from examples, and writes a lexicon.
    Learn(learn::LearnArgs),
    /// Shows the words of a lexicon, and what they look at.
    Words(words::WordsArgs),
    /// Shows, checks or exports a trace file.
    Trace(trace::TraceArgs),
    /// Plays a trace file, or simulates it again and compares bit for bit.
    Replay(replay::ReplayArgs),
    /// Copies a data folder while it is used, checks it, or restores a copy.
    Data(data::DataArgs),
    /// Checks whether a service is running (exit status 0 or 1).
    Health,
}

/// Exit status of a program that was interrupted, as shells use it.
const INTERRUPTED: u8 = 130;

/// Parses the arguments and runs the command: 0 done, 2 bad input or usage, 130 interrupted, 1 anything else.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    if cli.target.quiet {
        progress::silence();
    }
    if cli.version {
        return exit(Some(output::print(&version(cli.verbose))));
    }
    let Some(command) = cli.command else {
        return exit(Some(Err(Failure::input("no command is given; `vrdp --help` lists them"))));
    };
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return exit(Some(Err(Failure::other(error)))),
    };
    // These two handle SIGTERM and ctrl-c themselves.
    let handles_signals = matches!(command, Command::Serve(_) | Command::Replay(_));
    let done = runtime.block_on(async {
        tokio::select! {
            done = run(cli.target, command) => Some(done),
            // Dropping the command deletes its temporary store.
            _ = serve::interrupted(), if !handles_signals => None,
        }
    });
    // Background work must not keep the program alive.
    runtime.shutdown_background();
    exit(done)
}

/// Prints what failed, if anything; `None`: the command was interrupted.
fn exit(done: Option<Result<(), Failure>>) -> ExitCode {
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

async fn run(target: Target, command: Command) -> Result<(), Failure> {
    check(&target, &command)?;
    let target = &target.or_environment(|name| std::env::var_os(name));
    match command {
        Command::Serve(args) => serve::run(target, args).await,
        Command::Certs(args) => certs::run(&args),
        Command::Demo(args) => demo::run(args).await,
        Command::Fit(args) => fit::run(target, args).await,
        Command::Simulate(args) => simulate::run(target, args).await,
        Command::Ask(args) => ask::run(target, args).await,
        Command::Parse(args) => parse::run(target, args).await,
        Command::Compare(args) => compare::run(target, args).await,
        Command::Diagnose(args) => diagnose::run(target, args).await,
        Command::Discover(args) => discover::run(target, args).await,
        Command::Report(args) => report::run(target, args).await,
        Command::Calibrate(args) => calibrate::run(target, args).await,
        Command::Import(args) => import::run(target, args).await,
        Command::Convert(args) => convert::run(args),
        Command::Revise(args) => revise::run(target, args).await,
        Command::Show(args) => show::run(target, args).await,
        Command::Operations(args) => operations::run(target, args).await,
        Command::Effects(args) => effects::run(target, args).await,
        Command::Score(args) => score::run(target, args).await,
        Command::Learn(args) => learn::run(target, args).await,
        Command::Words(args) => words::run(target, args).await,
        Command::Trace(args) => trace::run(args),
        Command::Replay(args) => replay::run(args).await,
        Command::Data(args) => data::run(target, args).await,
        Command::Health => health::run(target).await,
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
    fn every_argument_is_described() {
        let command = Cli::command();
        let of = |c: &clap::Command| -> Vec<String> {
            let bare = c.get_arguments().filter(|a| a.get_help().is_none());
            bare.map(|a| format!("{} {}", c.get_name(), a.get_id())).collect()
        };
        let bare: Vec<String> = command.get_subcommands().flat_map(of).collect();
        assert!(bare.is_empty(), "without a description: {bare:?}");
    }

    #[test]
    fn options_without_effect_are_refused() {
        let refused = |line: &str| match Cli::try_parse_from(line.split(' ')) {
            Ok(cli) => check(&cli.target, &cli.command.unwrap()).err().map(|failure| failure.to_string()),
            Err(error) => Some(error.to_string()),
        };
        for fine in [
            "vrdp effects",
            "vrdp effects --data-dir d",
            "vrdp health --ca c",
            "vrdp effects --threads 2",
            "vrdp serve --threads 2",
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
            ("vrdp effects --server u --threads 2", "--threads"),
            ("vrdp health --threads 2", "--threads"),
            ("vrdp serve --server u", "--server"),
            ("vrdp replay f --data-dir d", "--data-dir"),
            ("vrdp health --data-dir d", "--data-dir"),
            ("vrdp discover s --frames 9", "--json"),
            ("vrdp replay f --verify --loop", "--loop"),
            ("vrdp --verbose effects", "--version"),
        ] {
            assert!(refused(line).is_some_and(|message| message.contains(named)), "{line}");
        }
    }

    #[test]
    fn the_version_needs_no_command() {
        for (line, verbose) in
            [("vrdp --version", false), ("vrdp -V", false), ("vrdp --version --verbose", true)]
        {
            let cli = Cli::try_parse_from(line.split(' ')).unwrap();
            assert!(cli.version && cli.verbose == verbose && cli.command.is_none(), "{line}");
        }
        assert!(Cli::try_parse_from(["vrdp"]).is_err());
    }
}
