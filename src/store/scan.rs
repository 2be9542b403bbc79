//! Reads the rows of a table in order, and goes on behind damaged pages.

use super::disk::database::caught;
use super::error::{StoreError, failed};
use super::schema::tables::{TableKind, after_prefix};
use redb::ReadOnlyTable;
use std::ops::{Bound, ControlFlow, RangeBounds};

pub type ByteTable = ReadOnlyTable<&'static str, &'static [u8]>;

/// Keys from the first to the second, in this order.
pub type KeyRange = (Bound<String>, Bound<String>);

/// What a scan finds.
pub enum Found<'r> {
    Row(&'r str, &'r [u8]),
    /// Rows between these keys cannot be read.
    Gap(KeyRange),
}

type VisitFound<'v> = &'v mut dyn FnMut(Found) -> Result<ControlFlow<()>, StoreError>;

/// How a walk over rows ended.
enum Walked {
    /// At the end of the range, or where the visitor stopped it.
    Whole,
    /// At damage.
    Broken,
}

/// Gives each row of the range to `visit`, by key, until it breaks off. What damage hides is given as gaps.
pub fn scan(table: &ByteTable, range: KeyRange, visit: VisitFound) -> Result<(), StoreError> {
    let mut last = None;
    let mut forward = |key: &str, value: &[u8]| {
        last = Some(key.to_string());
        visit(Found::Row(key, value))
    };
    if let Walked::Whole = walk(table, &range, false, &mut forward)? {
        return Ok(());
    }
    let start = last.map_or(range.0, Bound::Excluded);
    // From the other end, down to the damage.
    let behind = (start.clone(), range.1.clone());
    let mut keys: Vec<String> = vec![];
    let mut backward = |key: &str, _: &[u8]| {
        keys.push(key.to_string());
        Ok(ControlFlow::Continue(()))
    };
    walk(table, &behind, true, &mut backward)?;
    keys.reverse();
    let end = keys.first().map_or(range.1, |key| Bound::Excluded(key.clone()));
    if visit(Found::Gap((start, end)))?.is_break() {
        return Ok(());
    }
    for key in keys {
        let row = caught(|| table.get(key.as_str()).map_err(failed));
        let flow = match row {
            Ok(Some(row)) => caught(|| visit(Found::Row(&key, row.value())))?,
            Ok(None) | Err(StoreError::Damaged { .. }) => {
                visit(Found::Gap((Bound::Included(key.clone()), Bound::Included(key))))?
            }
            Err(error) => return Err(error),
        };
        if flow.is_break() {
            break;
        }
    }
    Ok(())
}

type VisitRow<'v> = &'v mut dyn FnMut(&str, &[u8]) -> Result<ControlFlow<()>, StoreError>;

/// Visits rows up to the first damage. Keys out of order are damage, too.
fn walk(
    table: &ByteTable,
    range: &KeyRange,
    is_reverse: bool,
    visit: VisitRow,
) -> Result<Walked, StoreError> {
    let bounds = (range.0.as_ref().map(String::as_str), range.1.as_ref().map(String::as_str));
    if is_empty(&bounds) {
        return Ok(Walked::Whole);
    }
    let mut rows = match caught(|| table.range::<&str>(bounds).map_err(failed)) {
        Ok(rows) => rows,
        Err(StoreError::Damaged { .. }) => return Ok(Walked::Broken),
        Err(error) => return Err(error),
    };
    let mut before: Option<String> = None;
    loop {
        let next = caught(|| {
            let row = if is_reverse { rows.next_back() } else { rows.next() };
            let Some((key, value)) = row.transpose().map_err(failed)? else { return Ok(None) };
            let key = key.value().to_string();
            // Its place in the page may be damaged: then this panics.
            let _ = value.value().len();
            Ok(Some((key, value)))
        });
        let (key, value) = match next {
            Ok(Some(row)) => row,
            Ok(None) => return Ok(Walked::Whole),
            Err(StoreError::Damaged { .. }) => return Ok(Walked::Broken),
            Err(error) => return Err(error),
        };
        let is_in_order = before.as_ref().is_none_or(|b| if is_reverse { key < *b } else { key > *b });
        if !is_in_order || !RangeBounds::<str>::contains(&bounds, &*key) {
            return Ok(Walked::Broken);
        }
        if visit(&key, value.value())?.is_break() {
            return Ok(Walked::Whole);
        }
        before = Some(key);
    }
}

/// Whether no key can be in the range; redb takes no range whose end is before its start.
fn is_empty(bounds: &(Bound<&str>, Bound<&str>)) -> bool {
    match bounds {
        (Bound::Included(from), Bound::Included(to)) => from > to,
        (Bound::Included(from) | Bound::Excluded(from), Bound::Included(to) | Bound::Excluded(to)) => {
            from >= to
        }
        _ => false,
    }
}

/// The keys of the heads of a range of rows.
pub fn head_range(kind: TableKind, (from, to): KeyRange) -> KeyRange {
    let of = |key: String| kind.head_key(&key);
    let all = of(String::new());
    let from = match from {
        Bound::Included(key) => Bound::Included(of(key)),
        Bound::Excluded(key) => Bound::Excluded(of(key)),
        Bound::Unbounded => Bound::Included(all.clone()),
    };
    let to = match to {
        Bound::Included(key) => Bound::Included(of(key)),
        Bound::Excluded(key) => Bound::Excluded(of(key)),
        Bound::Unbounded => after_prefix(&all).map_or(Bound::Unbounded, Bound::Excluded),
    };
    (from, to)
}
