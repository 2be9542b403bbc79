//! Values of cells as programs write them: numbers, nothing, and clock times.

/// Cells that hold nothing: R, pandas, spreadsheets and databases.
const ABSENT: [&str; 14] =
    ["", "na", "n/a", "#n/a", "nan", "none", "null", "nil", "-", "--", "inf", "-inf", "missing", "undefined"];
/// Ends of the names of images.
const IMAGES: [&str; 6] = [".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"];
const DAY: f64 = 86_400.0;

pub(super) fn is_absent(cell: &str) -> bool {
    ABSENT.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// Signs between groups of three digits: `1 234`, `1'234`, with spaces that do not break, too.
const GROUP_SIGNS: [char; 6] = [' ', '\'', '\u{2019}', '\u{a0}', '\u{202f}', '\u{2009}'];

/// The digits of a number whose groups of three `sign` separates; `None` if it does not separate such groups.
pub(super) fn ungrouped(cell: &str, sign: char) -> Option<String> {
    let (whole, rest) =
        match cell.find(['.', ',', 'e', 'E'].as_slice()).filter(|_| GROUP_SIGNS.contains(&sign)) {
            Some(at) => cell.split_at_checked(at)?,
            None => match cell.rfind(|c| (c == '.' || c == ',') && c != sign) {
                Some(at) => cell.split_at_checked(at)?,
                None => (cell, ""),
            },
        };
    let digits = whole.trim_start_matches(['+', '-']);
    let mut groups = digits.split(sign);
    let first = groups.next()?;
    let is_number = |group: &str| group.bytes().all(|b| b.is_ascii_digit());
    let rest_of: Vec<&str> = groups.collect();
    let fits = (1..=3).contains(&first.len())
        && is_number(first)
        && !first.starts_with('0')
        && !rest_of.is_empty()
        && rest_of.iter().all(|group| group.len() == 3 && is_number(group));
    fits.then(|| whole.replace(sign, "") + rest)
}

/// A number with groups of digits, without their signs. What could be decimals is left as it is.
fn plain_digits(cell: &str, decimal_commas: bool) -> Option<String> {
    let sign = if decimal_commas { '.' } else { ',' };
    let is_certain = cell.contains(',') && (!decimal_commas || cell.contains('.'));
    let grouped = is_certain.then(|| ungrouped(cell, sign)).flatten();
    grouped.or_else(|| {
        let sign = GROUP_SIGNS.into_iter().find(|sign| cell.contains(*sign))?;
        ungrouped(cell, sign)
    })
}

/// A finite number; its decimal sign is a comma where the table has those. The other sign may separate thousands.
pub(super) fn number(cell: &str, decimal_commas: bool) -> Option<f64> {
    // What `parse` reads beside numbers, such as "infinity", begins with a letter.
    let is_number = cell
        .trim_start_matches(['+', '-', '\u{2212}'])
        .starts_with(|c: char| c.is_ascii_digit() || ".,".contains(c));
    // Fortran's exponent, and the minus sign of typesetters.
    let plain = cell.replace('\u{2212}', "-").replace(['D', 'd'], "e");
    let digits = plain_digits(&plain, decimal_commas);
    let cell = digits.as_deref().unwrap_or(&plain);
    let value = match decimal_commas && cell.contains(',') {
        true => cell.replace(',', ".").parse::<f64>(),
        false => cell.parse::<f64>(),
    };
    value.ok().filter(|value| is_number && value.is_finite())
}

/// The number at the end of an image's name: 12 of `video/img0012.png`.
pub(super) fn image_number(cell: &str) -> Option<f64> {
    let lower = cell.to_lowercase();
    let stem = IMAGES.iter().find_map(|end| lower.strip_suffix(end))?;
    let digits = stem.bytes().rev().take_while(u8::is_ascii_digit).count();
    stem.get(stem.len() - digits..)?.parse().ok()
}

/// Seconds of a clock time, with or without a date: `01:02:03.5`, `2024-05-01 10:00:00,040`, `2024-05-01T10:00:00Z`.
pub(in crate::scene::files) fn clock(cell: &str) -> Option<f64> {
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
        for (cell, decimal_commas, value) in [
            ("1,234.5", false, Some(1234.5)),
            ("-1,234,567", false, Some(-1_234_567.0)),
            ("1.234,5", true, Some(1234.5)),
            ("1 234,5", true, Some(1234.5)),
            ("1\u{202f}234", false, Some(1234.0)),
            ("1'234.5", false, Some(1234.5)),
            ("12,34.5", false, None),
            ("0,123.5", false, None),
            ("1,2345.5", false, None),
            ("1.5,5", true, None),
            ("1 23", false, None),
        ] {
            assert_eq!(number(cell, decimal_commas), value, "{cell}");
        }
        assert_eq!([number("infinity", false), number("nan", false), number("", false)], [None; 3]);
        assert_eq!(clock("01:02:03.5"), Some(3723.5));
        assert_eq!(clock("2024-05-01T10:00:00Z"), Some(1_714_557_600.0));
        assert_eq!(clock("1970-01-01 00:01:00,25"), Some(60.25));
        assert_eq!([clock("12"), clock("a:b"), clock("2024-13-01 1:2:3"), clock("é:1")], [None; 4]);
    }
}
