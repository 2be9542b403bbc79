//! The names that columns have in tables of this and other programs, and what they hold.

use crate::scene::files::csv::vocabulary::is_unit;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum CsvColumn {
    Id,
    Time,
    Frame,
    X,
    Y,
    Yaw,
    Visible,
    Missing,
    Likelihood,
    Shape,
    Size,
    Mass,
    Material,
    Color,
}

/// Columns with their names, the best one first: words of lower case, joined by `_`.
const COLUMNS: [(CsvColumn, &[&str]); 14] = [
    (
        CsvColumn::Id,
        &[
            // Beside a `track_id`, an `id` counts rows.
            "track_id",
            "id",
            "object_id",
            "object",
            "track",
            "obj_id",
            "obj",
            "trackid",
            "particle",
            "puck",
            "ball",
            "marker",
            "individual",
            "animal",
            "identity",
            "bodypart",
            "body",
            "instance",
            "trajectory",
            "player",
            "name",
            "label",
            "instance_id",
            "person_id",
            "target_id",
            "cell_id",
            "player_id",
            "tid",
        ],
    ),
    (
        CsvColumn::Time,
        &[
            "t",
            "time",
            "seconds",
            "sec",
            "timestamp",
            "timestamps",
            "time_stamp",
            "elapsed",
            "elapsed_time",
            "datetime",
            "position_t",
            "stamp",
        ],
    ),
    (
        CsvColumn::Frame,
        &[
            "frame",
            "frame_id",
            "frameid",
            "frame_idx",
            "frame_index",
            "frame_number",
            "frame_no",
            "frame_num",
            "frame_nr",
            "framenumber",
            "frames",
            "image",
            "slice",
            "coords",
            "image_id",
            "image_number",
            "imagenumber",
            "frameno",
            "frameindex",
            "timepoint",
            "time_index",
            "timestep",
            "step",
        ],
    ),
    (CsvColumn::X, &["x", "cx", "xc", "xpos", "posx", "xcoord", "xcenter", "xcentroid", "xposition"]),
    (CsvColumn::Y, &["y", "cy", "yc", "ypos", "posy", "ycoord", "ycenter", "ycentroid", "yposition"]),
    (CsvColumn::Yaw, &["yaw", "theta", "angle", "orientation", "heading"]),
    (CsvColumn::Visible, &["visible", "seen", "tracked", "detected"]),
    (CsvColumn::Missing, &["missing", "lost"]),
    (CsvColumn::Likelihood, &["likelihood"]),
    (CsvColumn::Shape, &["shape"]),
    (CsvColumn::Size, &["size", "radius"]),
    (CsvColumn::Mass, &["mass"]),
    (CsvColumn::Material, &["material"]),
    (CsvColumn::Color, &["color", "colour"]),
];
/// How many of the names of each column are checked for typing errors: other programs have columns with similar names.
const CHECKED_NAMES: usize = 5;
/// Columns that each object may have for itself.
const OF_OBJECTS: [CsvColumn; 4] = [CsvColumn::X, CsvColumn::Y, CsvColumn::Yaw, CsvColumn::Likelihood];
/// Words beside an axis that name no object, as in `pos_x`.
const FILLERS: [&str; 17] = [
    "pos",
    "position",
    "center",
    "centre",
    "centroid",
    "wcentroid",
    "pcentroid",
    "coord",
    "coords",
    "coordinate",
    "loc",
    "location",
    "com",
    "point",
    "mean",
    "world",
    "axis",
];
/// Words beside an axis that make it something else than a position.
const NOT_POSITIONS: [&str; 36] = [
    "v",
    "vel",
    "velocity",
    "speed",
    "acc",
    "acceleration",
    "force",
    "momentum",
    "err",
    "error",
    "std",
    "sd",
    "sigma",
    "var",
    "cov",
    "min",
    "max",
    "flow",
    "orientation",
    "rotation",
    "rot",
    "quaternion",
    "quat",
    "q",
    "twist",
    "linear",
    "angular",
    "gyro",
    "accel",
    "magnetometer",
    "direction",
    "dir",
    "normal",
    "gravity",
    "covariance",
    "torque",
];
/// Words in front of a time or frame that make it another one.
const NOT_CLOCKS: [&str; 14] = [
    "delta", "dt", "exposure", "reaction", "since", "total", "max", "min", "first", "last", "start", "end",
    "lost", "to",
];
/// Characters between the words of a name.
const SEPARATORS: [char; 8] = ['_', '.', '-', ' ', '/', ':', '#', '\''];
/// A name of a position found in this way comes after those of [`COLUMNS`].
const LAST_RANK: usize = 100;

/// Columns of a program whose `mass` and `size` are those of an image (brightness, pixels), by other columns that it writes.
const OF_IMAGES: [&[&str]; 3] = [&["ecc", "signal"], &["likelihood"], &["instance_score"]];

/// What the name of a column says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ColumnName {
    pub column: CsvColumn,
    /// The object whose column it is, if the name says so: `A_x`, `x1`.
    pub object: Option<String>,
    /// The lower, the more it is the usual name of the column.
    pub rank: usize,
    /// As written: `mm` of `x [mm]`, `x (mm)`, `x_mm`, `x/mm`.
    pub unit: Option<String>,
}

/// The words of a name, joined by `_`, in lower case.
fn joined(words: &[&str]) -> String {
    words.join("_").to_lowercase()
}

fn listed(name: &str) -> Option<(CsvColumn, usize)> {
    COLUMNS.iter().find_map(|(column, names)| Some((*column, names.iter().position(|n| *n == name)?)))
}

/// The words of a name, and its unit.
fn words_and_unit(header: &str) -> (Vec<&str>, Option<String>) {
    let header = header.trim().trim_start_matches('#');
    let (name, bracketed) = match header.rsplit_once(['[', '(']) {
        Some((name, unit)) if unit.ends_with([']', ')']) => {
            (name, Some(unit.trim_end_matches([']', ')']).trim().to_lowercase()))
        }
        _ => (header, None),
    };
    let mut words: Vec<&str> = name.split(SEPARATORS).filter(|word| !word.is_empty()).collect();
    if bracketed.is_some() || words.len() < 2 || listed(&joined(&words)).is_some() {
        return (words, bracketed);
    }
    let unit = words.last().map(|word| word.to_lowercase()).filter(|word| is_unit(word));
    if unit.is_some() {
        words.pop();
    }
    (words, unit)
}

/// Axis and number of `x1` or `y12`; axis and letter of `Ax` or `xA`.
fn axis_and_object(word: &str) -> Option<(&str, &str)> {
    let is_axis = |part: &str| part.eq_ignore_ascii_case("x") || part.eq_ignore_ascii_case("y");
    let (first, rest) = word.split_at_checked(1)?;
    let names_object =
        |part: &str| part.len() == 1 && part.chars().all(|c| c.is_ascii_uppercase()) && part != "V";
    if is_axis(first) && !rest.is_empty() && (rest.bytes().all(|b| b.is_ascii_digit()) || names_object(rest))
    {
        return Some((first, rest));
    }
    (names_object(first) && ["x", "y"].contains(&rest)).then_some((rest, first))
}

/// The column that the last words of a name mean, as in `cmso_frame_id` or `header.stamp`.
fn clock_or_id(words: &[&str]) -> Option<CsvColumn> {
    let is_other = words.iter().any(|word| NOT_CLOCKS.contains(&word.to_lowercase().as_str()));
    (1..words.len()).find_map(|from| {
        let (column, _) = listed(&joined(words.get(from..)?))?;
        let is_single = words.len() - from == 1;
        match column {
            CsvColumn::Time | CsvColumn::Frame => (!is_other).then_some(column),
            CsvColumn::Id => (!is_single).then_some(column),
            _ => None,
        }
    })
}

/// What a column holds; `None`: nothing of use.
pub(super) fn column_name(header: &str) -> Option<ColumnName> {
    if header.contains([',', ';', '\t', '|', '"']) {
        return None;
    }
    let (words, unit) = words_and_unit(header);
    let name = joined(&words);
    if let Some((column, rank)) = listed(&name) {
        return Some(ColumnName { column, object: None, rank, unit });
    }
    if let Some(column) = clock_or_id(&words) {
        return Some(ColumnName { column, object: None, rank: LAST_RANK, unit });
    }
    let split = |word| axis_and_object(word).map_or(vec![word], |(axis, object)| vec![axis, object]);
    let words: Vec<&str> = words.into_iter().flat_map(split).collect();
    let column_of = |word: &&str| {
        let (column, rank) = listed(&word.to_lowercase())?;
        (OF_OBJECTS.contains(&column) && (rank == 0 || column == CsvColumn::Yaw)).then_some(column)
    };
    let mut found = words.iter().enumerate().filter_map(|(at, word)| Some((at, column_of(word)?)));
    let (Some((at, column)), None) = (found.next(), found.next()) else { return None };
    let others = words.iter().enumerate().filter(|(k, _)| *k != at).map(|(_, word)| *word);
    let is_filler = |word: &&str| FILLERS.contains(&word.to_lowercase().as_str());
    let (fillers, object): (Vec<&str>, Vec<&str>) = others.partition(is_filler);
    if object.iter().any(|word| NOT_POSITIONS.contains(&word.to_lowercase().as_str())) {
        return None;
    }
    let object = (!object.is_empty()).then(|| object.join("_"));
    Some(ColumnName { column, object, rank: LAST_RANK + fillers.len(), unit })
}

/// The unit that a name states.
pub(super) fn unit_of(header: &str) -> Option<String> {
    words_and_unit(header).1
}

/// The name, without its unit, to look for typing errors in.
pub(super) fn stem(header: &str) -> String {
    joined(&words_and_unit(header).0)
}

/// Names in which typing errors are reported.
pub(super) fn checked_names() -> impl Iterator<Item = &'static str> {
    COLUMNS.iter().flat_map(|(_, names)| names.iter().take(CHECKED_NAMES).copied())
}

/// The name that a column has in our own files.
pub(super) fn usual_name(column: CsvColumn) -> &'static str {
    let names = COLUMNS.iter().find(|(known, _)| *known == column).map(|(_, names)| *names);
    match column {
        CsvColumn::Id => "id",
        _ => names.and_then(|names| names.first()).copied().unwrap_or_default(),
    }
}

/// Whether the masses and sizes of a table with these columns are those of an image.
pub(super) fn measures_images(stems: &[String]) -> bool {
    OF_IMAGES.iter().any(|signs| signs.iter().all(|sign| stems.iter().any(|stem| stem == sign)))
}

/// Whether a line of these cells names a position: it is a header.
pub(super) fn names_positions<'a>(cells: impl Iterator<Item = &'a str>) -> bool {
    let found: Vec<ColumnName> = cells.filter_map(column_name).collect();
    let has =
        |column, object: &Option<String>| found.iter().any(|c| c.column == column && c.object == *object);
    found.iter().any(|c| c.column == CsvColumn::X && has(CsvColumn::Y, &c.object))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_programs_are_known() {
        let check = |name: &str, expected: Option<(CsvColumn, Option<&str>, Option<&str>)>| {
            let found = column_name(name).map(|c| (c.column, c.object, c.unit));
            let expected =
                expected.map(|(c, object, unit)| (c, object.map(String::from), unit.map(String::from)));
            assert_eq!(found, expected, "{name}");
        };
        for name in ["x", "pos_x", "X#wcentroid", "x_center", "POSITION_X", "centroid.x", " X "] {
            check(name, Some((CsvColumn::X, None, None)));
        }
        check("x [mm]", Some((CsvColumn::X, None, Some("mm"))));
        check("X (cm)", Some((CsvColumn::X, None, Some("cm"))));
        check("y_px", Some((CsvColumn::Y, None, Some("px"))));
        check("A_x_mm", Some((CsvColumn::X, Some("A"), Some("mm"))));
        for (name, object) in [
            ("A_x", "A"),
            ("x1", "1"),
            ("x_12", "12"),
            ("Ax", "A"),
            ("nose.x", "nose"),
            ("puck 1 x", "puck_1"),
        ] {
            check(name, Some((CsvColumn::X, Some(object), None)));
        }
        check("particle", Some((CsvColumn::Id, None, None)));
        check("time_ms", Some((CsvColumn::Time, None, Some("ms"))));
        check("nose_likelihood", Some((CsvColumn::Likelihood, Some("nose"), None)));
        for name in ["vx", "Vx", "v_x", "vel_x", "x_err", "raw_mass", "instance.score", "t;x;y", "note", ""] {
            check(name, None);
        }
    }
}
