//! Damage: each page zeroed, bits flipped, reads that fail. Each is a typed error of one record, and hides no other.

use super::*;
use crate::store::schema::rows::encode;
use crate::store::schema::tables::HEADS;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::panic;
use std::sync::atomic::Ordering;
use std::sync::{LazyLock, Once};
use std::time::{Duration, Instant};

const VIDEOS: usize = 40;
const PAGE: usize = 4096;

fn put(store: &Store, kind: redb::TableDefinition<&str, &[u8]>, key: &str, row: &[u8]) {
    let put = |db: &Database| {
        let write = db.begin_write().unwrap();
        write.open_table(kind).unwrap().insert(key, row).unwrap();
        write.commit().unwrap();
        Ok(())
    };
    store.db.run(put).unwrap();
}

#[tokio::test]
async fn a_damaged_row_is_reported_and_hides_no_other_row() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for (key, value) in [("a", 1.5), ("b", 2.5)] {
        store.put_lexicon(key, &value).await.unwrap();
    }
    let row = encode("a", &1.5).unwrap();
    for bit in 0..8 * row.len() {
        let mut flipped = row.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        put(&store, TableKind::Lexica.table(), "a", &flipped);
        let found = store.get::<f64>(TableKind::Lexica, "a").await;
        assert_eq!(found, Err(StoreError::Damaged { key: "lexica/a".into() }), "{bit}");
    }
    let listed = store.list_page(TableKind::Lexica, all(), |_: &f64, _| true).await.unwrap();
    assert_eq!((listed.rows[0].value, listed.rows.len(), listed.unreadable), (2.5, 1, 1));
    // As an older program wrote it: without a checksum, and with one of the value alone.
    put(&store, TableKind::Lexica.table(), "a", &row[..row.len() - 4]);
    assert_eq!(store.get(TableKind::Lexica, "a").await.unwrap(), Some(1.5));
    let mut old = row[..row.len() - 4].to_vec();
    old.extend(crc32fast::hash(&old).to_le_bytes());
    put(&store, TableKind::Lexica.table(), "a", &old);
    assert_eq!(store.get(TableKind::Lexica, "a").await.unwrap(), Some(1.5));
}

#[tokio::test]
async fn a_damaged_head_is_made_of_its_row_again() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for key in ["a", "b", "c"] {
        store.put_video(key, &scene(key, 5)).await.unwrap();
    }
    for key in ["a", "b", "c"] {
        put(&store, HEADS, &format!("videos/{key}"), b"?");
        let (keys, unreadable) = video_keys(&store).await.unwrap();
        assert_eq!((keys.join(""), unreadable), ("abc".into(), 0), "without the head of {key}");
    }
    put(&store, TableKind::Videos.table(), "b", b"?");
    assert_eq!(video_keys(&store).await.unwrap(), (vec!["a".into(), "c".into()], 1));
    // A row that only its head names is not one that does not exist.
    store
        .db
        .run(|db| {
            let write = db.begin_write().unwrap();
            write.open_table(TableKind::Videos.table()).unwrap().remove("c").unwrap();
            write.commit().unwrap();
            Ok(())
        })
        .unwrap();
    store.put_video("d", &scene("d", 5)).await.unwrap();
    let lost = store.get::<Scene>(TableKind::Videos, "d").await;
    assert!(lost.unwrap().is_some());
}

/// What the videos of the database hold; it is made once, as their noise is measured.
fn expected() -> &'static [Scene] {
    static SCENES: LazyLock<Vec<Scene>> =
        LazyLock::new(|| (0..VIDEOS).map(|k| scene(&format!("v{k:02}"), 10 + k)).collect());
    &SCENES
}

/// A database with videos whose keys are `v00`, `v01` ..., each with a model.
async fn image() -> Vec<u8> {
    let (disk, folder) = (MemoryDisk::default(), tempfile::tempdir().unwrap());
    let of = disk.clone();
    let store = Store::opened(folder.path(), move |_| database(of.clone()), migrate).unwrap();
    for (k, scene) in expected().iter().enumerate() {
        let key = format!("v{k:02}");
        store.put_video(&key, scene).await.unwrap();
        store.put_of_video(TableKind::Fits, &key, &format!("{key}/m"), &format!("model {k}")).await.unwrap();
    }
    drop(store);
    disk.image()
}

/// What happened to a database with one fault.
#[derive(Debug, Default, PartialEq)]
struct Outcome {
    /// It was refused when it was opened.
    refused: usize,
    /// A list failed as a whole, with a typed error.
    lists_failed: usize,
    damaged_rows: usize,
    /// Left out of lists, and counted there.
    counted: usize,
    /// Readable by their keys, but not in the list.
    not_listed: usize,
    /// What nobody can answer for: another error, or another value.
    wrong: Vec<String>,
}

/// Opens the image, reads all rows by key, lists them, and writes.
async fn look(disk: MemoryDisk, what: &str, outcome: &mut Outcome) {
    let folder = tempfile::tempdir().unwrap();
    let store = match Store::opened(folder.path(), move |_| database(disk.clone()), migrate) {
        Ok(store) => store,
        Err(StoreError::Unusable { .. } | StoreError::Newer { .. }) => {
            outcome.refused += 1;
            return;
        }
        Err(other) => return outcome.wrong.push(format!("{what}: opened: {other:?}")),
    };
    let mut readable = BTreeMap::new();
    for (k, scene) in expected().iter().enumerate() {
        let key = format!("v{k:02}");
        match store.get::<Scene>(TableKind::Videos, &key).await {
            Ok(Some(found)) if found == *scene => _ = readable.insert(key, ()),
            Err(StoreError::Damaged { key: named }) if !named.is_empty() => outcome.damaged_rows += 1,
            other => outcome.wrong.push(format!("{what}: {key}: {:?}", other.map(|found| found.is_some()))),
        }
    }
    match video_keys(&store).await {
        Ok((listed, unreadable)) => {
            outcome.counted += unreadable;
            let missing = readable.keys().filter(|key| !listed.contains(key)).count();
            outcome.not_listed += missing;
            if listed.len() + unreadable < VIDEOS && missing == 0 && unreadable == 0 {
                outcome.wrong.push(format!("{what}: {} listed, none counted", listed.len()));
            }
        }
        Err(StoreError::Damaged { .. }) => outcome.lists_failed += 1,
        Err(other) => outcome.wrong.push(format!("{what}: list: {other:?}")),
    }
    match store.list_page(TableKind::Fits, all(), |_: &String, _| true).await {
        Ok(listed) if listed.rows.len() + listed.unreadable >= VIDEOS => outcome.counted += listed.unreadable,
        Ok(listed) => {
            outcome.wrong.push(format!("{what}: {} models, {}", listed.rows.len(), listed.unreadable))
        }
        Err(StoreError::Damaged { .. }) => outcome.lists_failed += 1,
        Err(other) => outcome.wrong.push(format!("{what}: models: {other:?}")),
    }
    match store.put_video("w", &expected()[0]).await {
        Ok(()) | Err(StoreError::Damaged { .. }) => {}
        Err(other) => outcome.wrong.push(format!("{what}: put: {other:?}")),
    }
    match store.check() {
        Ok(_) | Err(StoreError::Damaged { .. }) => {}
        Err(other) => outcome.wrong.push(format!("{what}: check: {other:?}")),
    }
}

/// Panics inside redb are expected, and their messages say nothing.
fn without_messages_of_redb() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !panic.location().is_some_and(|place| place.file().contains("redb")) {
                others(panic);
            }
        }));
    });
}

#[tokio::test]
async fn each_page_zeroed_hides_no_healthy_video() {
    let image = image().await;
    let mut outcome = Outcome::default();
    without_messages_of_redb();
    for page in 0..image.len() / PAGE {
        let bytes = &image[page * PAGE..][..PAGE];
        if bytes.iter().all(|byte| *byte == 0) {
            continue;
        }
        let mut damaged = image.clone();
        damaged[page * PAGE..][..PAGE].fill(0);
        look(MemoryDisk::of(damaged), &format!("page {page}"), &mut outcome).await;
    }
    println!("{} pages: {outcome:?}", image.len() / PAGE);
    assert_eq!((outcome.not_listed, &outcome.wrong), (0, &vec![]), "{outcome:?}");
    assert!(outcome.damaged_rows > 0 && outcome.counted > 0);
}

/// Where the numbers of their children stand in pages that lead to others: in the last byte of each is the page's size.
fn page_sizes(image: &[u8]) -> Vec<usize> {
    let branches = (1..image.len() / PAGE).map(|page| page * PAGE).filter(|at| image[*at] == 2);
    let numbers = |at: usize| {
        let children = usize::from(u16::from_le_bytes([image[at + 2], image[at + 3]])) + 1;
        (0..children).map(move |child| at + 8 + 16 * children + 8 * child + 7)
    };
    branches.flat_map(numbers).collect()
}

#[tokio::test]
async fn a_page_that_leads_to_a_huge_one_is_not_followed() {
    let image = image().await;
    without_messages_of_redb();
    let sizes = page_sizes(&image);
    assert!(!sizes.is_empty());
    for at in sizes.into_iter().step_by(7) {
        let mut damaged = image.clone();
        // Twice as large sixteen times: 256 MiB.
        damaged[at] ^= 0x80;
        let (disk, mut outcome) = (MemoryDisk::of(damaged), Outcome::default());
        look(disk.clone(), &format!("byte {at}"), &mut outcome).await;
        assert!(disk.largest_read.load(Ordering::SeqCst) <= 1 << 20, "byte {at}");
        assert_eq!((outcome.not_listed, &outcome.wrong), (0, &vec![]), "{outcome:?}");
    }
}

/// The kinds of faults of the long trial.
const FAULTS: [&str; 6] = [
    "zeroed page",
    "flipped bit",
    "flipped bit of the header",
    "flipped page size",
    "failed read",
    "short read",
];
/// Bytes of the header of a database.
const HEADER: usize = 320;

/// A disk with the k-th fault.
fn faulty(image: &[u8], k: usize) -> MemoryDisk {
    let mut damaged = image.to_vec();
    // Steps of powers of the plastic number's inverse fall everywhere in all dimensions.
    let place = |step: f64, of: usize| (((k + 1) as f64 * step).fract() * of as f64) as usize;
    let [first, second, third] = [0.754_877_666, 0.569_840_291, 0.430_159_709];
    let used: Vec<usize> = (0..image.len() / PAGE)
        .filter(|page| image[page * PAGE..][..PAGE].iter().any(|byte| *byte != 0))
        .collect();
    let page = used[place(first, used.len())] * PAGE;
    match FAULTS[k % FAULTS.len()] {
        "zeroed page" => damaged[page..][..PAGE].fill(0),
        "flipped bit" => damaged[page + place(second, PAGE)] ^= 1 << place(third, 8),
        "flipped bit of the header" => damaged[place(first, HEADER)] ^= 1 << place(second, 8),
        "flipped page size" => {
            let sizes = page_sizes(image);
            // The upper 5 bits.
            damaged[sizes[place(first, sizes.len())]] ^= 8 << place(second, 5);
        }
        kind => {
            let error = if kind == "failed read" { ErrorKind::Other } else { ErrorKind::UnexpectedEof };
            let disk = MemoryDisk::of(damaged);
            disk.faults.lock().unwrap().reads = Some((5 + place(first, 60) as u64, error));
            return disk;
        }
    }
    MemoryDisk::of(damaged)
}

/// The long trial: `cargo test --lib thousand_faults -- --ignored --nocapture`.
#[tokio::test]
#[ignore = "takes minutes"]
async fn ten_thousand_faults_are_typed_and_hide_nothing() {
    let image = image().await;
    without_messages_of_redb();
    let mut outcomes = BTreeMap::<&str, (usize, Outcome, Duration, usize)>::new();
    for k in 0..10_000_usize {
        let (disk, kind) = (faulty(&image, k), FAULTS[k % FAULTS.len()]);
        let (faults, outcome, longest, largest) = outcomes.entry(kind).or_default();
        let start = Instant::now();
        look(disk.clone(), &format!("{kind} {k}"), outcome).await;
        *faults += 1;
        *longest = start.elapsed().max(*longest);
        *largest = disk.largest_read.load(Ordering::SeqCst).max(*largest);
    }
    for (kind, (faults, outcome, longest, largest)) in &outcomes {
        println!("{kind}: {faults} faults, at most {longest:.1?} and {largest} bytes at once: {outcome:?}");
    }
    for (kind, (_, outcome, longest, _)) in outcomes.iter().filter(|(kind, _)| !kind.contains("read")) {
        assert_eq!(outcome.wrong, Vec::<String>::new(), "{kind}");
        // One page in the place of another may hide rows from a list that goes on behind it.
        let most_hidden = if *kind == "flipped page size" { VIDEOS } else { 0 };
        assert!(outcome.not_listed <= most_hidden, "{kind}: {outcome:?}");
        assert!(*longest < Duration::from_secs(60), "{kind}");
    }
}

#[tokio::test]
async fn a_disk_that_fails_for_a_while_is_used_again() {
    let (disk, folder) = (MemoryDisk::of(image().await), tempfile::tempdir().unwrap());
    let of = disk.clone();
    let store = Store::opened(folder.path(), move |_| database(of.clone()), migrate).unwrap();
    disk.faults.lock().unwrap().writes = Some(0);
    assert!(matches!(store.put_video("w", &scene("w", 3)).await, Err(StoreError::Failed(_))));
    disk.faults.lock().unwrap().writes = None;
    store.put_video("w", &scene("w", 3)).await.unwrap();
    assert_eq!(video_keys(&store).await.unwrap().0.len(), VIDEOS + 1);
}
