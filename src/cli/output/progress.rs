//! Progress on standard error: bars on a terminal, lines elsewhere, nothing with --quiet.

use super::write::tell;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::cell::Cell;
use std::future::Future;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Interval at which spinners and clocks are redrawn.
const TICK: Duration = Duration::from_millis(200);
/// Interval of the lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Share of the work (per cent) from which on the time left is estimated.
const ESTIMATED_FROM: f64 = 2.0;
/// A reply that takes less shows no spinner.
const SPINNER_AFTER: Duration = Duration::from_secs(1);

static QUIET: AtomicBool = AtomicBool::new(false);

/// Switches all progress off.
pub fn silence() {
    QUIET.store(true, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// A bar of `length` steps; `template` is one of indicatif.
pub fn bar(length: u64, template: &str) -> ProgressBar {
    styled(ProgressBar::new(length), template)
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    if is_quiet() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// The progress of a task in one or several steps: a bar on a terminal, else a line every ten seconds.
pub struct TaskProgress {
    bar: ProgressBar,
    steps: usize,
    start: Instant,
    last_line: Cell<Instant>,
}

impl TaskProgress {
    pub fn new(steps: usize) -> TaskProgress {
        let bar = ProgressBar::new(100 * steps as u64);
        let bar = styled(bar, "{msg:24} {bar:40} {percent:>3} %  {elapsed}, about {eta} left");
        if !bar.is_hidden() {
            bar.enable_steady_tick(TICK);
        }
        let now = Instant::now();
        TaskProgress { bar, steps, start: now, last_line: Cell::new(now) }
    }

    /// Shows that `done` steps are complete and the fraction of the current one, 0 to 1; `label` says what runs.
    pub fn show(&self, label: &str, done: usize, fraction: f64) {
        self.bar.set_message(label.to_string());
        self.bar.set_position(100 * done as u64 + (100.0 * fraction) as u64);
        if self.bar.is_hidden() && !is_quiet() && self.last_line.get().elapsed() >= LINE_EVERY {
            self.last_line.set(Instant::now());
            tell(&line(label, [done, self.steps], fraction, self.start.elapsed()));
        }
    }
}

/// A line of progress: `fitting a (2 of 3): 40 % after 20 s, about 30 s left`.
fn line(label: &str, [done, steps]: [usize; 2], fraction: f64, elapsed: Duration) -> String {
    let of = if steps > 1 { format!(" ({} of {steps})", (done + 1).min(steps)) } else { String::new() };
    let percent = 100.0 * (done as f64 + fraction.clamp(0.0, 1.0)) / steps.max(1) as f64;
    let seconds = elapsed.as_secs_f64();
    let left = match percent {
        low if low < ESTIMATED_FROM => String::new(),
        _ => format!(", about {} left", duration(seconds * (100.0 - percent) / percent)),
    };
    format!("{label}{of}: {percent:.0} % after {}{left}", duration(seconds))
}

/// `40 s`, or `3 min 5 s`.
fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    if whole < 60 { format!("{whole} s") } else { format!("{} min {} s", whole / 60, whole % 60) }
}

impl Drop for TaskProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Waits for a reply without progress: a spinner labelled `what` if it takes long, else a line every ten seconds.
pub async fn during<T>(what: &'static str, reply: impl Future<Output = T>) -> T {
    let mut reply = std::pin::pin!(reply);
    let start = Instant::now();
    if let Ok(reply) = tokio::time::timeout(SPINNER_AFTER, &mut reply).await {
        return reply;
    }
    let spinner = styled(ProgressBar::new_spinner(), "{spinner} {msg}  {elapsed}");
    spinner.set_message(what);
    spinner.enable_steady_tick(TICK);
    let reply = loop {
        match tokio::time::timeout(LINE_EVERY, &mut reply).await {
            Ok(reply) => break reply,
            Err(_) if spinner.is_hidden() && !is_quiet() => {
                tell(&format!("{what}: {} so far", duration(start.elapsed().as_secs_f64())));
            }
            Err(_) => {}
        }
    };
    spinner.finish_and_clear();
    reply
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_runs_how_far_it_is_and_how_long_it_takes() {
        let after = |seconds| Duration::from_secs(seconds);
        assert_eq!(
            line("fitting a", [0, 1], 0.25, after(20)),
            "fitting a: 25 % after 20 s, about 1 min 0 s left"
        );
        assert_eq!(
            line("fitting b", [1, 4], 0.0, after(10)),
            "fitting b (2 of 4): 25 % after 10 s, about 30 s left"
        );
        assert_eq!(line("searching", [0, 1], 0.001, after(10)), "searching: 0 % after 10 s");
    }
}
