//! Reads the text that Tracker (Open Source Physics) exports: names of the tracks, a header, and rows of t, x, y.

use super::validate::Report;
use super::{MAX_FRAMES, Object, Sample, Scene, SceneError, Shape, Track, WorldKind};
use crate::num::vec2;

/// Frame rate where one time only is given (1/s).
const FPS: f64 = 25.0;

/// Whether a text looks like Tracker's: a header with t, x and y, and none of ids.
pub fn is_tracker(text: &str) -> bool {
    table(text).is_some()
}

/// Rows of cells; the first is the header. The cells above it are names.
struct Table<'a> {
    names: Vec<&'a str>,
    header: Vec<String>,
    /// Line number and cells.
    rows: Vec<(usize, Vec<&'a str>)>,
    /// Whether commas are decimal points.
    commas: bool,
}

fn table(text: &str) -> Option<Table<'_>> {
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
    let cells = |line: &'_ str| -> Vec<String> { split(line, delimiter) };
    let names = above.map(|(_, l)| l.split(delimiter).map(str::trim).collect()).unwrap_or_default();
    let rows = lines[at + 1..].iter().filter(|(_, l)| !l.trim().is_empty());
    Some(Table {
        names,
        header: cells(lines[at].1),
        rows: rows.map(|(n, l)| (n + 1, l.split(delimiter).map(str::trim).collect())).collect(),
        commas: delimiter != ',',
    })
}

/// Reads Tracker's text: one column t, and columns x and y for each track. Lengths are multiplied by `scale` (m); every
/// object is a disc of radius `size` (m). Also gives the names of the tracks, in the order of the objects.
pub fn parse_tracker(
    name: &str,
    text: &str,
    scale: f64,
    size: f64,
) -> Result<(Scene, Vec<String>), SceneError> {
    let mut r = Report::default();
    let Some(table) = table(text) else {
        r.add("header", "is missing; a row must name the columns t, x and y");
        r.finish()?;
        return Err(SceneError { violations: vec![] });
    };
    // Each x has the next y, and the last t before it.
    let mut blocks: Vec<(usize, usize, usize)> = vec![];
    let mut t = None;
    for (k, column) in table.header.iter().enumerate() {
        match column.as_str() {
            "t" => t = Some(k),
            "x" => {
                let y = (k + 1..table.header.len()).find(|&j| table.header[j] == "y");
                match (t, y) {
                    (Some(t), Some(y)) => blocks.push((t, k, y)),
                    _ => r.add(format!("header, column {}", k + 1), "has no t before it or no y behind it"),
                }
            }
            _ => {}
        }
    }
    let mut number = |line: usize, cells: &[&str], k: usize| -> Option<f64> {
        let cell = cells.get(k).filter(|c| !c.is_empty())?;
        let text = if table.commas { cell.replace(',', ".") } else { cell.to_string() };
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v),
            Ok(_) => None,
            Err(_) => {
                r.add(format!("line {line}, column {}", k + 1), format!("is {cell:?}; give a number"));
                None
            }
        }
    };
    let mut seen: Vec<Vec<(f64, f64, f64)>> = vec![vec![]; blocks.len()];
    for (line, cells) in &table.rows {
        for (&(t, x, y), seen) in blocks.iter().zip(&mut seen) {
            if let (Some(t), Some(x), Some(y)) =
                (number(*line, cells, t), number(*line, cells, x), number(*line, cells, y))
            {
                seen.push((t, scale * x, scale * y));
            }
        }
    }
    let mut times: Vec<f64> = seen.iter().flatten().map(|s| s.0).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < 1e-6);
    if times.len() > MAX_FRAMES {
        r.add("t", format!("has {} times; at most {MAX_FRAMES} frames are allowed", times.len()));
    }
    r.finish()?;
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    let fps = steps.get(steps.len() / 2).map_or(FPS, |step| 1.0 / step);
    let track = |seen: &Vec<(f64, f64, f64)>| {
        let sample = |&(t, x, y): &(f64, f64, f64)| Sample {
            frame: times.partition_point(|&known| known < t - 5e-7),
            position: vec2(x, y),
            yaw: None,
            covariance: None,
        };
        Track { samples: seen.iter().map(sample).collect() }
    };
    let object = |id: u32| Object {
        id,
        color: String::new(),
        material: String::new(),
        shape: Shape::Disc { radius: size },
        mass: None,
    };
    // The name above a column, or the nearest one to the left.
    let label = |(k, &(t, x, _)): (usize, &(usize, usize, usize))| {
        let named = |k: usize| {
            let name =
                table.names.get(k).map(|n| n.trim_start_matches('#').trim_start_matches("multi:").trim());
            name.filter(|n| !n.is_empty()).map(str::to_string)
        };
        let from = if k == 0 { 0 } else { t.min(x) };
        (from..=x).rev().find_map(named).unwrap_or(format!("track {k}"))
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
        objects: (0..blocks.len() as u32).map(object).collect(),
        tracks: seen.iter().map(track).collect(),
        outliers: vec![],
    };
    Ok((scene.validate()?, blocks.iter().enumerate().map(label).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracker_s_text_is_read() {
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
