//! Reads the text that Tracker (Open Source Physics) exports: track names, a header, and rows of t, x, y.

use crate::num::{quantile, vec2};
use crate::scene::limits::{DEFAULT_FPS, MAX_FRAMES};
use crate::scene::object::{Object, Shape};
use crate::scene::observation::{Sample, Scene, Track, WorldKind};
use crate::scene::violations::{SceneError, SceneViolations};

/// Times closer than this are the same frame (s).
const SAME_TIME_S: f64 = 1e-6;

/// Whether a text is an export of Tracker: its header has t, x and y, and no id.
pub fn is_tracker(text: &str) -> bool {
    tracker_table(text).is_some()
}

/// The cells of a file.
struct TrackerTable<'a> {
    /// The cells above the header: names of tracks.
    names: Vec<&'a str>,
    header: Vec<String>,
    /// Line number and cells.
    rows: Vec<(usize, Vec<&'a str>)>,
    /// Whether commas are decimal points.
    decimal_commas: bool,
}

/// The columns of one track: indices of t, x and y.
struct TrackColumns {
    t: usize,
    x: usize,
    y: usize,
}

/// A time (s) and a position (m).
type TimedPoint = (f64, f64, f64);

fn tracker_table(text: &str) -> Option<TrackerTable<'_>> {
    let lines: Vec<(usize, &str)> = text.trim_start_matches('\u{feff}').lines().enumerate().collect();
    let split = |line: &'_ str, delimiter: char| -> Vec<String> {
        line.split(delimiter).map(|c| c.trim().trim_start_matches('#').trim().to_ascii_lowercase()).collect()
    };
    let (at, delimiter) = lines.iter().enumerate().find_map(|(at, (_, line))| {
        let has = |d: &char| {
            let cells = split(line, *d);
            ["t", "x", "y"].iter().all(|name| cells.iter().any(|c| c == name))
                && !cells.iter().any(|c| c == "id")
        };
        ['\t', ';', ','].into_iter().find(has).map(|d| (at, d))
    })?;
    let above = lines[..at].iter().rev().find(|(_, l)| !l.trim().is_empty());
    let names = above.map(|(_, l)| l.split(delimiter).map(str::trim).collect()).unwrap_or_default();
    let rows = lines[at + 1..].iter().filter(|(_, l)| !l.trim().is_empty());
    Some(TrackerTable {
        names,
        header: split(lines[at].1, delimiter),
        rows: rows.map(|(n, l)| (n + 1, l.split(delimiter).map(str::trim).collect())).collect(),
        decimal_commas: delimiter != ',',
    })
}

impl TrackerTable<'_> {
    /// The columns of each track: an x, the next y, and the last t before the x.
    fn tracks(&self, r: &mut SceneViolations) -> Vec<TrackColumns> {
        let mut tracks = vec![];
        let mut t = None;
        for (k, column) in self.header.iter().enumerate() {
            match column.as_str() {
                "t" => t = Some(k),
                "x" => {
                    let y = (k + 1..self.header.len()).find(|&j| self.header[j] == "y");
                    match (t, y) {
                        (Some(t), Some(y)) => tracks.push(TrackColumns { t, x: k, y }),
                        _ => r.add(
                            format!("header, column {}", k + 1),
                            "has no t before it or no y behind it; add the column",
                        ),
                    }
                }
                _ => {}
            }
        }
        tracks
    }

    /// A finite number; `None` where the cell is empty or wrong.
    fn number(&self, line: usize, cells: &[&str], k: usize, r: &mut SceneViolations) -> Option<f64> {
        let cell = cells.get(k).filter(|c| !c.is_empty())?;
        let text = if self.decimal_commas { cell.replace(',', ".") } else { cell.to_string() };
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v),
            Ok(_) => None,
            Err(_) => {
                r.add(format!("line {line}, column {}", k + 1), format!("is {cell:?}; give a number"));
                None
            }
        }
    }

    /// The points of each track, with lengths multiplied by `scale`.
    fn points(&self, tracks: &[TrackColumns], scale: f64, r: &mut SceneViolations) -> Vec<Vec<TimedPoint>> {
        let mut points: Vec<Vec<TimedPoint>> = vec![vec![]; tracks.len()];
        for (line, cells) in &self.rows {
            for (columns, points) in tracks.iter().zip(&mut points) {
                let [t, x, y] = [columns.t, columns.x, columns.y].map(|k| self.number(*line, cells, k, r));
                if let (Some(t), Some(x), Some(y)) = (t, x, y) {
                    points.push((t, scale * x, scale * y));
                }
            }
        }
        points
    }

    /// The name above a track's columns, or the nearest one to the left.
    fn name(&self, k: usize, columns: &TrackColumns) -> String {
        let named = |k: usize| {
            let name =
                self.names.get(k).map(|n| n.trim_start_matches('#').trim_start_matches("multi:").trim());
            name.filter(|n| !n.is_empty()).map(str::to_string)
        };
        let from = if k == 0 { 0 } else { columns.t.min(columns.x) };
        (from..=columns.x).rev().find_map(named).unwrap_or(format!("track {k}"))
    }
}

/// Reads Tracker's text: one column t, and columns x and y for each track. Lengths are multiplied by `scale` (m); every
/// object is a disc of radius `size` (m). Also returns the names of the tracks, in the order of the objects.
pub fn parse_tracker(
    name: &str,
    text: &str,
    scale: f64,
    size: f64,
) -> Result<(Scene, Vec<String>), SceneError> {
    let Some(table) = tracker_table(text) else {
        return Err(SceneError::single("header", "is missing; name the columns t, x and y in one row"));
    };
    let mut r = SceneViolations::default();
    let columns = table.tracks(&mut r);
    let points = table.points(&columns, scale, &mut r);
    let mut times: Vec<f64> = points.iter().flatten().map(|s| s.0).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < SAME_TIME_S);
    if times.len() > MAX_FRAMES {
        r.add("t", format!("has {} times; at most {MAX_FRAMES} frames are allowed", times.len()));
    }
    r.finish()?;
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let fps = quantile(&mut steps, 0.5).map_or(DEFAULT_FPS, |step| 1.0 / step);
    let sample = |&(t, x, y): &TimedPoint| Sample {
        frame: times.partition_point(|&known| known < t - 0.5 * SAME_TIME_S),
        position: vec2(x, y),
        yaw: None,
        covariance: None,
    };
    let object = |id: u32| Object {
        id,
        color: String::new(),
        material: String::new(),
        shape: Shape::Disc { radius: size },
        mass: None,
    };
    let scene = Scene {
        name: name.into(),
        setup: None,
        world: WorldKind::Table,
        fps,
        times: times.clone(),
        camera: None,
        table: None,
        noise_sigma: None,
        objects: (0..columns.len() as u32).map(object).collect(),
        tracks: points.iter().map(|points| Track { samples: points.iter().map(sample).collect() }).collect(),
        outliers: vec![],
        findings: vec![],
    };
    let names = columns.iter().enumerate().map(|(k, columns)| table.name(k, columns)).collect();
    Ok((scene.validate()?, names))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_export_of_tracker_is_read() {
        let one = "mass A\t\t\nt\tx\ty\n0,0\t1,0\t2,0\n0,1\t\t\n0,2\t1,2\t2,5\n";
        assert!(is_tracker(one) && !is_tracker("id,t,x,y\n1,0,0,0\n"));
        let (scene, names) = parse_tracker("a", one, 0.01, 0.03).unwrap();
        assert_eq!((scene.times.as_slice(), scene.tracks[0].samples.len()), (&[0.0, 0.2][..], 2));
        assert!((scene.tracks[0].samples[1].position.y - 0.025).abs() < 1e-12);
        assert_eq!(names, ["mass A"]);
        let two = "multi:,mass_A,,mass_B,\nt,x,y,x,y\n0,0,0,1,1\n0.04,0.1,0,,\n0.08,0.2,0,1,1.1\n";
        let (scene, names) = parse_tracker("a", two, 1.0, 0.03).unwrap();
        assert_eq!((scene.tracks[1].samples.len(), scene.tracks[1].samples[1].frame), (2, 2));
        assert_eq!((scene.fps.round(), names), (25.0, vec!["mass_A".to_string(), "mass_B".to_string()]));
        let wrong = parse_tracker("a", "t\tx\ty\n0\tq\t1\n1\t1\t1\n", 1.0, 0.03).unwrap_err();
        assert_eq!(wrong.violations[0].path, "line 2, column 2");
    }
}
