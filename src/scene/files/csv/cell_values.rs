//! Values of cells as programs write them: numbers, nothing, and clock times.

/// Cells that hold nothing: R, pandas, spreadsheets and databases.
const ABSENT: [&str; 14] =
    ["", "na", "n/a", "#n/a", "nan", "none", "null", "nil", "-", "--", "inf", "-inf", "missing", "undefined"];
const DAY: f64 = 86_400.0;

pub(super) fn is_absent(cell: &str) -> bool {
    ABSENT.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// A finite number; its decimal sign is a comma where the table has those.
pub(super) fn number(cell: &str, decimal_commas: bool) -> Option<f64> {
    // What `parse` reads beside numbers, such as "infinity", begins with a letter.
    let is_number = cell
        .trim_start_matches(['+', '-', '\u{2212}'])
        .starts_with(|c: char| c.is_ascii_digit() || ".,".contains(c));
    // Fortran's exponent, and the minus sign of typesetters.
    let plain = cell.replace('\u{2212}', "-").replace(['D', 'd'], "e");
    let cell = plain.as_str();
    let value = match decimal_commas && cell.contains(',') {
        true => cell.replace(',', ".").parse::<f64>(),
        false => cell.parse::<f64>(),
    };
    value.ok().filter(|value| is_number && value.is_finite())
}

/// Seconds of a clock time, with or without a date: `01:02:03.5`, `2024-05-01 10:00:00,040`, `2024-05-01T10:00:00Z`.
pub(super) fn clock(cell: &str) -> Option<f64> {
    let (date, time) =
        cell.trim_end_matches('Z').split_once(['T', ' ']).map_or((None, cell), |(d, t)| (Some(d), t));
    let time = time.split(['+', 'Z']).next()?.replace(',', ".");
    let parts: Vec<f64> = time.split(':').map(|part| number(part, false)).collect::<Option<_>>()?;
    if !(2..=3).contains(&parts.len()) {
        return None;
    }
    let seconds = parts.iter().fold(0.0, |sum, part| 60.0 * sum + part);
    Some(seconds + DAY * date.map_or(Some(0.0), day)?)
}

/// The number of a day, `year-month-day`, from 1970 on.
fn day(date: &str) -> Option<f64> {
    let parts: Vec<i64> = date.split(['-', '/']).map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let &[year, month @ 1..=12, day @ 1..=31] = parts.as_slice() else { return None };
    if !(1900..=3000).contains(&year) {
        return None;
    }
    // Years that begin with March, so that the leap day is the last.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    Some((365 * year + leap_days + (153 * month + 2) / 5 + day - 719_469) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_clock_times_are_read() {
        assert_eq!(
            [number("1,5", true), number("1,5", false), number("-.5e1", false)],
            [Some(1.5), None, Some(-5.0)]
        );
        assert_eq!([number("infinity", false), number("nan", false), number("", false)], [None; 3]);
        assert_eq!(clock("01:02:03.5"), Some(3723.5));
        assert_eq!(clock("2024-05-01T10:00:00Z"), Some(1_714_557_600.0));
        assert_eq!(clock("1970-01-01 00:01:00,25"), Some(60.25));
        assert_eq!([clock("12"), clock("a:b"), clock("2024-13-01 1:2:3"), clock("é:1")], [None; 4]);
    }
}
