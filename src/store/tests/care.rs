//! Backups of a folder that is being written, checks, and folders made of backups.

use super::*;
use crate::store::schema::tables::{HEADS, row_tables};
use redb::{ReadableTable, TableHandle};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// All rows of all tables, byte by byte.
fn rows(store: &Store) -> BTreeMap<String, Vec<u8>> {
    let rows = |db: &Database| {
        let read = db.begin_read().unwrap();
        let mut rows = BTreeMap::new();
        for table in row_tables() {
            for row in read.open_table(table).unwrap().iter().unwrap() {
                let (key, value) = row.unwrap();
                rows.insert(format!("{}/{}", table.name(), key.value()), value.value().to_vec());
            }
        }
        Ok(rows)
    };
    store.db.run(rows).unwrap()
}

async fn filled(folder: &Path) -> Store {
    let store = Store::open(folder).unwrap();
    for tenant in [Tenant::default(), Tenant::new("lab").unwrap()] {
        let store = store.of(&tenant);
        for k in 0..10 {
            let (video, file) = (format!("v{k}"), Bytes::from(format!("file {k}")));
            let id = blake3::hash(&file).to_hex().to_string();
            store.put_video(&video, &scene(&video, 30)).await.unwrap();
            store.put_of_video(TableKind::Fits, &video, &format!("{video}/m"), &k).await.unwrap();
            store.put_blob(&id, file.clone()).await.unwrap();
            let record = serde_json::json!({ "id": id, "video": video, "size_bytes": file.len() });
            store.put_trace(&video, &id, &record, file.len() as u64).await.unwrap();
        }
        store.put_operation("o", &serde_json::json!({ "videos": [] }), vec![]).await.unwrap();
        store.end_operation("o", &serde_json::json!({ "videos": [] }), b"result".to_vec()).await.unwrap();
    }
    store
}

#[tokio::test]
async fn a_backup_restores_every_row_and_file() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("old"), folder.path().join("new"));
    let store = filled(&old).await;
    let mut archive = vec![];
    let report = store.backup(&mut archive).unwrap();
    assert_eq!((report.trace_files, &report.unreadable), (20, &vec![]));
    let restored = restore(archive.as_slice(), &new).unwrap();
    assert_eq!((restored.rows, restored.trace_files), (report.rows, 20));
    let copy = Store::open(&new).unwrap();
    assert_eq!(rows(&copy), rows(&store));
    for entry in std::fs::read_dir(old.join("traces")).unwrap() {
        let entry = entry.unwrap();
        let same = std::fs::read(new.join("traces").join(entry.file_name())).unwrap();
        assert_eq!(std::fs::read(entry.path()).unwrap(), same);
    }
    assert_eq!(copy.check().unwrap().faults, []);
    // Into an empty folder only, and of a whole backup only.
    assert!(matches!(restore(archive.as_slice(), &new), Err(StoreError::Unusable { .. })));
    for cut in [0, 5, archive.len() / 2, archive.len() - 1] {
        let there = folder.path().join("cut");
        let error = restore(&archive[..cut], &there).unwrap_err();
        assert!(matches!(error, StoreError::Unusable { .. }), "{error}");
        assert_eq!(std::fs::read_dir(&there).unwrap().count(), 0, "nothing is left at {cut}");
    }
    for at in (0..archive.len()).step_by(97) {
        let mut damaged = archive.clone();
        damaged[at] ^= 4;
        let there = folder.path().join("damaged");
        assert!(restore(damaged.as_slice(), &there).is_err(), "byte {at}");
        assert_eq!(std::fs::read_dir(&there).unwrap().count(), 0);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_is_of_one_moment_while_others_write_and_delete() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("old"), folder.path().join("new"));
    let store = filled(&old).await;
    let stop = Arc::new(AtomicBool::new(false));
    let (busy, is_over) = (store.clone(), stop.clone());
    let writer = tokio::spawn(async move {
        let mut count = 0;
        while !is_over.load(Ordering::SeqCst) {
            // The models of a video are as many as its number says, at every moment.
            let video = format!("w{}", count % 3);
            busy.put_video(&video, &scene(&video, 30)).await.unwrap();
            busy.put_of_video(TableKind::Fits, &video, &format!("{video}/m"), &1).await.unwrap();
            busy.delete_video(&video).await.unwrap();
            let trace = format!("v{}", count % 10);
            busy.delete_video(&trace).await.unwrap();
            count += 1;
        }
        count
    });
    for round in 0..5 {
        let from = store.clone();
        let archive = tokio::task::spawn_blocking(move || {
            let mut archive = vec![];
            from.backup(&mut archive).map(|report| (archive, report))
        });
        let (archive, report) = archive.await.unwrap().unwrap();
        assert_eq!(report.unreadable, Vec::<String>::new());
        let there = new.join(round.to_string());
        restore(archive.as_slice(), &there).unwrap();
        let copy = Store::open(&there).unwrap();
        assert_eq!(copy.check().unwrap().faults, [], "each row has its head, and each trace its file");
    }
    stop.store(true, Ordering::SeqCst);
    assert!(writer.await.unwrap() > 0, "the writer went on");
}

/// Says when the first row is written, and then waits until it may go on.
struct PausedWriter {
    to: Vec<u8>,
    has_started: Option<mpsc::Sender<()>>,
    may_go_on: mpsc::Receiver<()>,
}

impl Write for PausedWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // The first bytes are written before the database is read.
        if !self.to.is_empty()
            && let Some(started) = self.has_started.take()
        {
            started.send(()).map_err(io::Error::other)?;
            self.may_go_on.recv().map_err(io::Error::other)?;
        }
        self.to.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A backup during which `meanwhile` happens.
async fn backup_while(store: &Store, meanwhile: impl AsyncFnOnce(&Store)) -> (Vec<u8>, BackupReport) {
    let ((has_started, started), (go_on, may_go_on)) = (mpsc::channel(), mpsc::channel());
    let from = store.clone();
    let backup = tokio::task::spawn_blocking(move || {
        let mut to = PausedWriter { to: vec![], has_started: Some(has_started), may_go_on };
        from.backup(&mut to).map(|report| (to.to, report))
    });
    tokio::task::spawn_blocking(move || started.recv().unwrap()).await.unwrap();
    meanwhile(store).await;
    go_on.send(()).unwrap();
    backup.await.unwrap().unwrap()
}

#[tokio::test]
async fn traces_that_go_during_a_backup_leave_no_head_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(&folder.path().join("old")).await;
    let (archive, report) = backup_while(&store, async |store| {
        assert!(store.delete_video("v3").await.unwrap());
    })
    .await;
    assert_eq!((report.trace_files, report.unreadable), (19, vec![]));
    let new = folder.path().join("new");
    restore(archive.as_slice(), &new).unwrap();
    assert_eq!(Store::open(&new).unwrap().check().unwrap().faults, []);
}

#[tokio::test]
async fn a_damaged_row_ends_no_backup_and_nobody_waits_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path()).await;
    let damage = |db: &Database| {
        let write = db.begin_write().unwrap();
        write.open_table(TableKind::Videos.table()).unwrap().insert("v3", &b"?"[..]).unwrap();
        write.commit().unwrap();
        Ok(())
    };
    store.db.run(damage).unwrap();
    let failures = [StoreError::Damaged { key: String::new() }, StoreError::Full];
    let (_, report) = backup_while(&store, async |store| {
        let read = store.get::<Scene>(TableKind::Videos, "v3");
        let read = tokio::time::timeout(Duration::from_secs(20), read).await.expect("it waits for nobody");
        assert_eq!(read, Err(StoreError::Damaged { key: "videos/v3".into() }));
        for error in failures {
            let (store, failure) = (store.clone(), error.clone());
            let failing = store.blocking("x".into(), move |_| Err::<(), _>(failure));
            let failed = tokio::time::timeout(Duration::from_secs(20), failing).await.expect("nor does this");
            assert_eq!(failed, Err(error.at("x")));
        }
        assert!(!store.db.must_yield());
    })
    .await;
    assert_eq!(report, store.backup(io::sink()).unwrap());
}

#[tokio::test]
async fn a_check_names_what_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path()).await;
    let traces = store.orphans().await.unwrap();
    assert_eq!(traces, Vec::<String>::new());
    let names = || std::fs::read_dir(folder.path().join("traces")).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<_> = names().filter(|p| !p.display().to_string().contains("lab.")).collect();
    files.sort();
    std::fs::write(&files[0], b"other").unwrap();
    std::fs::remove_file(&files[1]).unwrap();
    store
        .db
        .run(|db| {
            let write = db.begin_write().unwrap();
            write.open_table(TableKind::Videos.table()).unwrap().insert("v3", &b"?"[..]).unwrap();
            write.open_table(TableKind::Fits.table()).unwrap().remove("v4/m").unwrap();
            write.open_table(HEADS).unwrap().remove("videos/v5").unwrap();
            write.commit().unwrap();
            Ok(())
        })
        .unwrap();
    let report = store.check().unwrap();
    let stem = |k: usize| files[k].file_stem().unwrap().to_str().unwrap().to_string();
    let mut expected = vec![
        format!("traces/{}", stem(0)),
        format!("traces/{}", stem(1)),
        "videos/v3".into(),
        "fits/v4/m".into(),
        "heads/videos/v5".into(),
    ];
    expected.sort();
    let mut found: Vec<String> = report.faults.iter().map(|f| f.record.clone()).collect();
    found.sort();
    assert_eq!(found, expected, "{report:?}");
}
