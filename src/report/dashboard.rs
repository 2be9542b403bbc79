//! The service at a glance: what runs, the videos with their models and reports, the latest traces.

use super::chart::number;
use super::document::document;
use maud::{Markup, html};

const STYLE: &str = include_str!("dashboard.css");
const SCRIPT: &str = include_str!("dashboard.js");
/// Digits of an id that people are shown.
const DIGITS: usize = 8;

/// What the page shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Dashboard {
    pub version: &'static str,
    /// Jobs on the CPU pool and before it.
    pub running: usize,
    pub waiting: usize,
    /// Fits that were computed since the start.
    pub fits: u64,
    pub jobs: Vec<JobRow>,
    /// By id.
    pub videos: Vec<VideoRow>,
    /// The last of these videos, where there are more.
    pub next: Option<String>,
    /// The latest, newest first.
    pub traces: Vec<TraceRow>,
    pub traces_in_all: usize,
    pub trace_bytes: u64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct JobRow {
    pub kind: &'static str,
    pub video: String,
    /// 0 to 1.
    pub progress: f64,
    /// Since it began (s).
    pub seconds: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct VideoRow {
    pub id: String,
    pub name: String,
    pub frames: usize,
    pub objects: usize,
    pub seconds: f64,
    pub models: usize,
    /// Residual of the latest revision and measurement noise, root mean square (m).
    pub error: Option<(f64, f64)>,
    /// The kind of effect that the latest revision added.
    pub added: Option<String>,
    /// The videos of each discovery that is kept, this one first.
    pub discoveries: Vec<Vec<String>>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct TraceRow {
    pub id: String,
    pub video: String,
    pub about: String,
    pub size_bytes: u64,
}

/// The page; its script fetches it again, from the same place only.
pub fn dashboard(shown: &Dashboard) -> String {
    let main = html! {
        header {
            p class="kind" { "vrdp " (shown.version) " · " span id="fresh" role="status" {} }
            h1 { "The service at a glance" }
        }
        div id="live" { (tiles(shown)) (jobs(shown)) (videos(shown)) (traces(shown)) }
    };
    document("vrdp", "; connect-src 'self'", STYLE, main, SCRIPT)
}

fn tiles(shown: &Dashboard) -> Markup {
    let tile =
        |title: &str, value: String| html! { div class="tile" { span { (title) } strong { (value) } } };
    html! {
        div class="tiles" {
            (tile("jobs that run", shown.running.to_string()))
            (tile("jobs that wait", shown.waiting.to_string()))
            (tile("fits since the start", shown.fits.to_string()))
            (tile("traces", format!("{} · {}", shown.traces_in_all, size(shown.trace_bytes))))
        }
    }
}

fn jobs(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Jobs" }
        @if shown.jobs.is_empty() { p class="quiet" { "Nothing runs." } }
        @else { div class="scroll" { table {
            thead { tr { th { "job" } th { "video" } th { "progress" } th { "for" } } }
            tbody { @for job in &shown.jobs { tr {
                th { (job.kind) }
                td { (name_of(shown, &job.video)) }
                td { progress max="1" value=(format!("{:.3}", job.progress)) aria-label=(job.kind) {} " " (percent(job.progress)) }
                td { (format!("{:.0} s", job.seconds)) }
            } } }
        } } }
    }
}

fn videos(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Videos" }
        @if shown.videos.is_empty() {
            p class="quiet" { "None yet. Post one with CreateVideo, or: " code { "vrdp fit SCENE --server http://HOST:PORT" } }
        } @else { div class="scroll" { table {
            thead { tr { th { "video" } th { "length" } th { "objects" } th { "models" } th { "error" } th { "noise" } th { "added" } th { "report" } } }
            tbody { @for video in &shown.videos { tr {
                th { (video.name) " " span class="quiet" { (short(&video.id)) } }
                td { (format!("{:.1} s · {} frames", video.seconds, video.frames)) }
                td { (video.objects) }
                td { (video.models) }
                td { (mm(video.error.map(|e| e.0))) }
                td { (mm(video.error.map(|e| e.1))) }
                td { (video.added.as_deref().unwrap_or("")) }
                td { (reports(video)) }
            } } }
        } } }
        @if let Some(last) = &shown.next { p { a href={ "/?after=" (last) } { "more videos" } } }
    }
}

/// Links to the discoveries that were made, and to one that the video alone would begin.
fn reports(video: &VideoRow) -> Markup {
    let alone = video.discoveries.iter().any(|videos| videos.len() == 1);
    let home = format!("/videos/{}/report", video.id);
    html! {
        @for videos in &video.discoveries {
            @match videos.get(1..) {
                Some(others) if !others.is_empty() => a href={ (home) "?with=" (others.join(",")) } { "of " (videos.len()) " videos" },
                _ => a href=(home) { "open" },
            }
            " "
        }
        @if !alone { a href=(home) { "make" } }
    }
}

fn traces(shown: &Dashboard) -> Markup {
    html! {
        h2 { "Latest traces" }
        @if shown.traces.is_empty() { p class="quiet" { "None yet: every fit, simulation and answer leaves one." } }
        @else { div class="scroll" { table {
            thead { tr { th { "trace" } th { "video" } th { "of" } th { "size" } } }
            tbody { @for trace in &shown.traces { tr {
                th { a href={ "/traces/" (trace.id) ".mcap" } { (short(&trace.id)) ".mcap" } }
                td { (name_of(shown, &trace.video)) }
                td { (trace.about) }
                td { (size(trace.size_bytes)) }
            } } }
        } } }
    }
}

fn name_of<'d>(shown: &'d Dashboard, id: &'d str) -> &'d str {
    shown.videos.iter().find(|v| v.id == id).map_or(short(id), |v| &v.name)
}

/// Ids are of ASCII.
fn short(id: &str) -> &str {
    id.get(..DIGITS).unwrap_or(id)
}

fn mm(error: Option<f64>) -> String {
    error.map(|e| format!("{} mm", number(1e3 * e))).unwrap_or_default()
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.1} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.0} kB", b / 1e3),
    }
}
