//! Reads rows: one by its key, or lists of them, which skip and count what is damaged.

use super::disk::database::caught;
use super::error::{StoreError, damaged, failed};
use super::folder::Store;
use super::scan::{ByteTable, Found, KeyRange, head_range, scan};
use super::schema::heads::{PlainHead, RowHead, VideoHead};
use super::schema::rows::{decode, readable};
use super::schema::tables::{HEADS, TableKind, after_prefix};
use crate::scene::Scene;
use redb::{Database, ReadTransaction, ReadableDatabase};
use serde::de::DeserializeOwned;
use std::ops::{Bound, ControlFlow};
use tokio_util::sync::CancellationToken;

/// Most bytes of the rows of one page: what it holds in memory is a small multiple.
const PAGE_BYTES: usize = 8 << 20;

/// A value with its key and the time at which it was stored first (milliseconds after 1970).
#[derive(Debug, Clone, PartialEq)]
pub struct TimedRow<T> {
    pub key: String,
    pub value: T,
    pub created_ms: Option<u64>,
}

/// Which rows a page has: those whose keys start with `prefix` and come after `after`, at most `size`.
#[derive(Debug, Clone, Copy)]
pub struct PageStart<'p> {
    pub prefix: &'p str,
    pub after: &'p str,
    pub size: usize,
}

/// One page of rows, by key.
#[derive(Debug, Clone, PartialEq)]
pub struct Listing<T> {
    pub rows: Vec<TimedRow<T>>,
    /// The key after which the next page starts; `None`: this is the last.
    pub next: Option<String>,
    /// Damaged rows that were left out of this page.
    pub unreadable: usize,
}

/// A row of a list: its whole key, its value, when it was stored first, and its bytes.
struct Listed<'r, T> {
    key: &'r str,
    value: T,
    created_ms: Option<u64>,
    bytes: usize,
}

/// Whether the caller of a scan has left.
type IsLeft<'l> = &'l dyn Fn() -> bool;

type VisitListed<'v, T> = &'v mut dyn FnMut(Listed<T>) -> ControlFlow<()>;

impl Store {
    /// The value of a row. One that its head names, but that is not there, is damaged.
    pub async fn get<T>(&self, kind: TableKind, key: &str) -> Result<Option<T>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
    {
        let key = self.key(key);
        let record = kind.head_key(&key);
        self.blocking(record.clone(), move |db| {
            let read = db.begin_read().map_err(failed)?;
            let table = read.open_table(kind.table()).map_err(failed)?;
            match table.get(key.as_str()).map_err(failed)? {
                Some(found) => decode(&record, &key, found.value()).map(Some),
                None if head(heads(&read).as_ref(), &record).is_some() => Err(damaged(&record)),
                None => Ok(None),
            }
        })
        .await
    }

    /// When a row was stored first (milliseconds after 1970).
    pub async fn created_ms(&self, kind: TableKind, key: &str) -> Result<Option<u64>, StoreError> {
        let head_key = kind.head_key(&self.key(key));
        self.blocking(head_key.clone(), move |db| {
            let read = db.begin_read().map_err(failed)?;
            Ok(head(heads(&read).as_ref(), &head_key).and_then(|head| head.created_ms))
        })
        .await
    }

    /// Up to `limit` values that `keep` accepts, whose keys start with `prefix` and come after `after`, by key. It has no
    /// limit of bytes, and says nothing of damaged rows: it is for small rows of the service itself.
    pub async fn list<T, K>(
        &self,
        kind: TableKind,
        prefix: &str,
        after: &str,
        limit: usize,
        keep: K,
    ) -> Result<Vec<(String, T)>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
        K: Fn(&T) -> bool + Send + 'static,
    {
        let found = vec![];
        let step = move |found: &mut Vec<(String, T)>, row: TimedRow<T>| {
            if keep(&row.value) {
                found.push((row.key, row.value));
            }
            if found.len() < limit { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        if limit == 0 {
            return Ok(found);
        }
        Ok(self.fold(kind, (prefix, after), found, step).await?.0)
    }

    /// A page of values that `keep` accepts, with the times at which they were stored first (milliseconds after 1970).
    pub async fn list_page<T, K>(
        &self,
        kind: TableKind,
        page: PageStart<'_>,
        keep: K,
    ) -> Result<Listing<T>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
        K: Fn(&T, Option<u64>) -> bool + Send + 'static,
    {
        let (store, range, size) = (self.clone(), self.range(page.prefix, page.after), page.size);
        self.scanning(kind, move |db, is_left| {
            let mut page = OpenPage::new(&store, size, keep);
            let unreadable = visit_rows(db, (kind, range), is_left, &mut |row| page.add(row))?;
            Ok(page.listing(unreadable))
        })
        .await
    }

    /// A page of the heads of videos that `keep` accepts.
    pub async fn list_videos<K>(&self, page: PageStart<'_>, keep: K) -> Result<Listing<VideoHead>, StoreError>
    where
        K: Fn(&VideoHead, Option<u64>) -> bool + Send + 'static,
    {
        let (store, range, size) = (self.clone(), self.range(page.prefix, page.after), page.size);
        self.scanning(TableKind::Videos, move |db, is_left| {
            let mut page = OpenPage::new(&store, size, keep);
            let unreadable = visit_videos(db, range, is_left, &mut |row| page.add(row))?;
            Ok(page.listing(unreadable))
        })
        .await
    }

    /// Passes the values whose keys start with `prefix` and come after `after` to `step`, one at a time, until it breaks
    /// off. Returns the state, and the number of damaged rows.
    pub async fn fold<T, S, F>(
        &self,
        kind: TableKind,
        (prefix, after): (&str, &str),
        mut state: S,
        mut step: F,
    ) -> Result<(S, usize), StoreError>
    where
        T: DeserializeOwned + Send + 'static,
        S: Send + 'static,
        F: FnMut(&mut S, TimedRow<T>) -> ControlFlow<()> + Send + 'static,
    {
        let (store, range) = (self.clone(), self.range(prefix, after));
        self.scanning(kind, move |db, is_left| {
            let mut visit =
                |row: Listed<T>| step(&mut state, store.timed(row.key, row.value, row.created_ms));
            let unreadable = visit_rows(db, (kind, range), is_left, &mut visit)?;
            Ok((state, unreadable))
        })
        .await
    }

    /// The same over the heads of all the tenant's videos.
    pub async fn fold_videos<S, F>(&self, mut state: S, mut step: F) -> Result<(S, usize), StoreError>
    where
        S: Send + 'static,
        F: FnMut(&mut S, TimedRow<VideoHead>) + Send + 'static,
    {
        let (store, range) = (self.clone(), self.range("", ""));
        self.scanning(TableKind::Videos, move |db, is_left| {
            let mut visit = |row: Listed<VideoHead>| {
                step(&mut state, store.timed(row.key, row.value, row.created_ms));
                ControlFlow::Continue(())
            };
            let unreadable = visit_videos(db, range, is_left, &mut visit)?;
            Ok((state, unreadable))
        })
        .await
    }

    /// Runs a scan of a table, which ends early where its caller leaves.
    async fn scanning<T, F>(&self, kind: TableKind, scan: F) -> Result<T, StoreError>
    where
        T: Send + 'static,
        F: FnOnce(&Database, IsLeft) -> Result<T, StoreError> + Send + 'static,
    {
        let token = CancellationToken::new();
        let _left = token.clone().drop_guard();
        self.blocking(kind.name().into(), move |db| scan(db, &|| token.is_cancelled())).await
    }

    fn timed<T>(&self, key: &str, value: T, created_ms: Option<u64>) -> TimedRow<T> {
        TimedRow { key: self.short(key), value, created_ms }
    }

    /// The key without the tenant.
    fn short(&self, key: &str) -> String {
        key.strip_prefix(self.tenant.prefix()).unwrap_or(key).to_string()
    }

    /// The whole keys that start with `prefix` and come after `after`.
    pub(super) fn range(&self, prefix: &str, after: &str) -> KeyRange {
        let (prefix, after) = (self.key(prefix), self.key(after));
        let end = match prefix.as_str() {
            // The keys of other tenants come after those of the unnamed one.
            "" if !self.everyone => Some("~".to_string()),
            prefix => after_prefix(prefix),
        };
        let start = if after > prefix { Bound::Excluded(after) } else { Bound::Included(prefix) };
        (start, end.map_or(Bound::Unbounded, Bound::Excluded))
    }
}

/// A page that is being filled.
struct OpenPage<'s, T, K> {
    store: &'s Store,
    size: usize,
    keep: K,
    rows: Vec<TimedRow<T>>,
    bytes: usize,
    is_full: bool,
}

impl<'s, T, K: Fn(&T, Option<u64>) -> bool> OpenPage<'s, T, K> {
    fn new(store: &'s Store, size: usize, keep: K) -> Self {
        OpenPage { store, size, keep, rows: vec![], bytes: 0, is_full: false }
    }

    /// Adds a row. The first row for which there is no room ends the page.
    fn add(&mut self, row: Listed<T>) -> ControlFlow<()> {
        if !(self.keep)(&row.value, row.created_ms) {
            return ControlFlow::Continue(());
        }
        self.bytes = self.bytes.saturating_add(row.bytes);
        if self.rows.len() == self.size || (self.bytes > PAGE_BYTES && !self.rows.is_empty()) {
            self.is_full = true;
            return ControlFlow::Break(());
        }
        self.rows.push(self.store.timed(row.key, row.value, row.created_ms));
        ControlFlow::Continue(())
    }

    fn listing(self, unreadable: usize) -> Listing<T> {
        let next = self.rows.last().filter(|_| self.is_full).map(|row| row.key.clone());
        Listing { rows: self.rows, next, unreadable }
    }
}

/// The heads, unless damage hides them.
fn heads(read: &ReadTransaction) -> Option<ByteTable> {
    caught(|| read.open_table(HEADS).map_err(failed)).ok()
}

/// The head under this key, if it can be read.
fn head(heads: Option<&ByteTable>, head_key: &str) -> Option<PlainHead> {
    let heads = heads?;
    caught(|| PlainHead::of(heads, head_key)).ok().flatten()
}

/// A table, unless damage hides it.
fn table(read: &ReadTransaction, kind: TableKind) -> Result<ByteTable, StoreError> {
    caught(|| read.open_table(kind.table()).map_err(failed))
}

/// Gives the readable rows of a range to `visit`; returns how many are damaged. Their heads name rows that a damaged page
/// hides.
fn visit_rows<T: DeserializeOwned>(
    db: &Database,
    (kind, range): (TableKind, KeyRange),
    is_left: IsLeft,
    visit: VisitListed<T>,
) -> Result<usize, StoreError> {
    let read = db.begin_read().map_err(failed)?;
    let rows = table(&read, kind)?;
    // Nobody asks for the times of other rows.
    let times = if kind == TableKind::Fits { heads(&read) } else { None };
    let mut unreadable = 0;
    let mut found = |found: Found| -> Result<ControlFlow<()>, StoreError> {
        match found {
            _ if is_left() => Ok(ControlFlow::Break(())),
            Found::Row(key, row) => match readable(key, row) {
                Some(value) => {
                    let created_ms =
                        head(times.as_ref(), &kind.head_key(key)).and_then(|head| head.created_ms);
                    Ok(visit(Listed { key, value, created_ms, bytes: row.len() }))
                }
                None => {
                    unreadable += 1;
                    Ok(ControlFlow::Continue(()))
                }
            },
            Found::Gap(gap) => {
                let mut flow = ControlFlow::Continue(());
                let mut of_head = |head: Found| {
                    let key = match head {
                        Found::Row(head_key, _) => head_key.split_once('/').map(|(_, key)| key.to_string()),
                        Found::Gap(_) => None,
                    };
                    let value = key.as_ref().and_then(|key| {
                        caught(|| {
                            Ok(rows
                                .get(key.as_str())
                                .map_err(failed)?
                                .and_then(|row| readable(key, row.value())))
                        })
                        .ok()
                        .flatten()
                    });
                    match (key, value) {
                        (Some(key), Some(value)) => {
                            flow = visit(Listed { key: &key, value, created_ms: None, bytes: 0 });
                        }
                        _ => unreadable += 1,
                    }
                    Ok(flow)
                };
                scan(&read.open_table(HEADS).map_err(failed)?, head_range(kind, gap), &mut of_head)?;
                Ok(flow)
            }
        }
    };
    scan(&rows, range, &mut found)?;
    Ok(unreadable)
}

/// Gives the readable heads of a range of videos to `visit`; returns how many videos are damaged. A head that cannot be
/// read is made of its row again.
fn visit_videos(
    db: &Database,
    range: KeyRange,
    is_left: IsLeft,
    visit: VisitListed<VideoHead>,
) -> Result<usize, StoreError> {
    let kind = TableKind::Videos;
    let read = db.begin_read().map_err(failed)?;
    let mut unreadable = 0;
    // Where damage started: behind this key.
    let mut gap: Option<Bound<String>> = None;
    let mut last = range.0.clone();
    let mut fill = |gap: KeyRange, visit: VisitListed<VideoHead>| -> Result<ControlFlow<()>, StoreError> {
        let (hidden, flow) = visit_scenes(&read, gap, visit)?;
        unreadable += hidden;
        Ok(flow)
    };
    let heads = caught(|| read.open_table(HEADS).map_err(failed));
    let mut found = |found: Found| -> Result<ControlFlow<()>, StoreError> {
        let (head_key, row) = match found {
            _ if is_left() => return Ok(ControlFlow::Break(())),
            Found::Row(head_key, row) => (head_key, row),
            Found::Gap(_) => {
                gap.get_or_insert(last.clone());
                return Ok(ControlFlow::Continue(()));
            }
        };
        let head =
            RowHead::<VideoHead>::read(head_key, row).and_then(|head| Some((head.created_ms, head.shown?)));
        let key = head_key.split_once('/').map_or("", |(_, key)| key);
        let Some((created_ms, value)) = head else {
            gap.get_or_insert(last.clone());
            return Ok(ControlFlow::Continue(()));
        };
        if let Some(start) = gap.take()
            && fill((start, Bound::Excluded(key.to_string())), &mut *visit)?.is_break()
        {
            return Ok(ControlFlow::Break(()));
        }
        last = Bound::Excluded(key.to_string());
        Ok(visit(Listed { key, value, created_ms, bytes: row.len() }))
    };
    match heads {
        Ok(heads) => scan(&heads, head_range(kind, range.clone()), &mut found)?,
        Err(_) => gap = Some(range.0),
    }
    if let Some(start) = gap {
        // At the end, or where the page was full: then no more is added.
        fill((start, range.1), visit)?.is_break();
    }
    Ok(unreadable)
}

/// Gives the heads of the rows of a range to `visit`, made of the scenes. Returns how many are damaged.
fn visit_scenes(
    read: &ReadTransaction,
    range: KeyRange,
    visit: VisitListed<VideoHead>,
) -> Result<(usize, ControlFlow<()>), StoreError> {
    let (mut unreadable, mut flow) = (0, ControlFlow::Continue(()));
    let mut found = |found: Found| {
        match found {
            Found::Row(key, row) => match readable::<Scene>(key, row) {
                Some(scene) => {
                    let value = VideoHead::of(&scene);
                    flow = visit(Listed { key, value, created_ms: None, bytes: 0 });
                }
                None => unreadable += 1,
            },
            Found::Gap(_) => unreadable += 1,
        }
        Ok(flow)
    };
    scan(&table(read, TableKind::Videos)?, range, &mut found)?;
    Ok((unreadable, flow))
}
