//! Tables of motion-capture programs (Motive, Vicon): names, units and rates stand in lines of their own.

use super::TableText;
use super::record_table::quoted;
use ::csv::ReaderBuilder;

/// Lines in front of the header that are looked at.
const HEADER_LINES: usize = 12;
/// Kinds of columns that Motive has.
const RIGID_BODY: &str = "rigid body";

/// The table with lines and names as ours; `None`: it is of another program.
pub(super) fn table(text: &str) -> Option<TableText> {
    match text.trim_start_matches('"') {
        start if start.starts_with("Format Version,") => motive(text),
        start if start.starts_with("Trajectories") => vicon(text),
        start if start.starts_with("comment,") => old_motive(text),
        start if start.starts_with("PathFileType") => motion_analysis(text),
        _ => None,
    }
}

fn cells(line: &str) -> Vec<String> {
    let reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(line.as_bytes());
    let record = reader.into_records().next().and_then(Result::ok).unwrap_or_default();
    record.iter().map(|cell| cell.trim().to_string()).collect()
}

/// Motive's export: the lines above the header become comments, its columns get the names of their objects.
fn motive(text: &str) -> Option<TableText> {
    let lines: Vec<Vec<String>> = text.lines().take(HEADER_LINES).map(cells).collect();
    let at = lines.iter().position(|line| line.first().is_some_and(|cell| cell == "Frame"))?;
    let header = lines.get(at)?;
    let about = lines.first()?;
    let stated = |key: &str| {
        let at = about.iter().position(|cell| cell == key)?;
        about.get(at + 1).cloned()
    };
    let of = |row: &dyn Fn(&Vec<String>) -> bool| lines.get(1..at)?.iter().find(|line| row(line));
    let holds = |word: &'static str| {
        move |line: &Vec<String>| line.iter().any(|cell| cell.eq_ignore_ascii_case(word))
    };
    let what = of(&holds("position"))?;
    let kinds = of(&|line| {
        line.iter()
            .any(|cell| cell.to_lowercase().starts_with("rigid body") || cell == "Marker" || cell == "Bone")
    })?;
    let names = lines.iter().skip_while(|line| *line != kinds).nth(1)?;
    let has_bodies = kinds.iter().any(|kind| kind.eq_ignore_ascii_case(RIGID_BODY));
    let named = |(at, axis): (usize, &String)| {
        let cell = |line: &Vec<String>| line.get(at).cloned().unwrap_or_default();
        let is_axis = ["X", "Y", "Z"].contains(&axis.as_str());
        let is_taken =
            cell(what) == "Position" && (!has_bodies || cell(kinds).eq_ignore_ascii_case(RIGID_BODY));
        match is_axis {
            true if is_taken => quoted(&format!("{}_{axis}", cell(names).replace([':', ' '], "-"))),
            true => String::new(),
            false => quoted(axis),
        }
    };
    let header: Vec<String> = header.iter().enumerate().map(named).collect();
    let unit = match stated("Length Units")?.to_lowercase().as_str() {
        "millimeters" | "mm" => "mm",
        "centimeters" | "cm" => "cm",
        _ => "m",
    };
    let body: Vec<&str> = text.lines().skip(at + 1).collect();
    let notes = format!("# unit: {unit}\n{}", "#\n".repeat(at - 1));
    let taken = if has_bodies { "Motive's rigid bodies" } else { "Motive's markers" };
    let taken = vec![format!("{taken}, in {unit}")];
    Some(TableText { text: format!("{notes}{}\n{}\n", header.join(","), body.join("\n")), taken })
}

/// Vicon's export: its first two lines state what follows, and the rate.
fn vicon(text: &str) -> Option<TableText> {
    let rest = text.split_once('\n')?.1;
    let (rate, rest) = rest.split_once('\n')?;
    let rate: f64 = rate.trim_matches([',', ' ', '"']).parse().ok().filter(|rate| *rate > 0.0)?;
    let taken = vec![format!("Vicon's trajectories, {rate} frames/s")];
    Some(TableText { text: format!("# fps: {rate}\n#\n{rest}"), taken })
}

/// A TRC file of Motion Analysis and OpenSim: rate and unit stand in its third line, names of markers in the fourth.
fn motion_analysis(text: &str) -> Option<TableText> {
    let separator = if text.lines().nth(3)?.contains('\t') { '\t' } else { ',' };
    let split =
        |line: &str| line.split(separator).map(|cell| cell.trim().to_string()).collect::<Vec<String>>();
    let mut lines = text.lines().skip(1);
    let (keys, values, names, axes) =
        (split(lines.next()?), split(lines.next()?), split(lines.next()?), split(lines.next()?));
    let stated = |key: &str| values.get(keys.iter().position(|known| known == key)?);
    let rate: f64 = stated("DataRate")?.parse().ok().filter(|rate| *rate > 0.0)?;
    let unit = stated("Units")?.to_lowercase();
    let (mut header, mut name) = (vec!["frame".to_string(), "t".to_string()], String::new());
    for (at, axis) in axes.iter().enumerate().skip(2) {
        if let Some(own) = names.get(at).filter(|own| !own.is_empty()) {
            name = own.replace([' ', ':'], "-");
        }
        let letter = axis.chars().next().filter(|letter| "XYZ".contains(*letter));
        header.push(letter.map(|letter| format!("{name}_{letter}")).unwrap_or_default());
    }
    let body: Vec<&str> = lines.collect();
    let notes = format!("# unit: {unit}\n# fps: {rate}\n#\n#\n");
    let text = format!("{notes}{}\n{}\n", header.join(&separator.to_string()), body.join("\n"));
    Some(TableText { text, taken: vec![format!("markers of a TRC file, in {unit}, {rate} frames/s")] })
}

/// The export of older versions of Motive: a row for each frame with its bodies one after another (m).
fn old_motive(text: &str) -> Option<TableText> {
    let mut table = String::from("t,id,x,y,z\n");
    let (mut found, mut width) = (false, 11);
    for line in text.lines() {
        let cells = cells(line);
        let is = |word: &str| cells.first().is_some_and(|cell| cell == word);
        if is("comment") && line.contains("(ID, x,y,z, qx, qy, qz, qw") && !line.contains("yaw") {
            width = 8;
        }
        if !is("frame") {
            continue;
        }
        let (time, bodies) = (cells.get(2)?, cells.get(3)?.parse::<usize>().ok()?);
        for body in 0..bodies.min(crate::scene::limits::MAX_OBJECTS) {
            let from = 4 + width * body;
            let [id, x, y, z] = [0, 1, 2, 3].map(|k| cells.get(from + k).cloned().unwrap_or_default());
            found = true;
            table += &format!("{time},{id},{x},{y},{z}\n");
        }
    }
    found.then(|| TableText { text: table, taken: vec!["NaturalPoint's rigid bodies, in m".into()] })
}
