//! The store on real folders, and on a disk in memory that fails as it is asked to.

mod care;
mod damage;
mod disk;
mod full;
mod schema;

use super::disk::database::database;
use super::schema::migrations::migrate;
use super::schema::tables::META;
use super::*;
use crate::scene::{Scene, parse_csv};
use bytes::Bytes;
use disk::MemoryDisk;
use redb::{Database, ReadableDatabase};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};

/// A video of so many frames.
fn scene(name: &str, frames: usize) -> Scene {
    let rows: String = (0..frames).map(|frame| format!("1,{frame},{},{}\n", 10 * frame, frame % 7)).collect();
    parse_csv(name, &format!("# fps: 25\n# size: 50 mm\nid,frame,x [mm],y [mm]\n{rows}")).unwrap()
}

fn all() -> PageStart<'static> {
    PageStart { prefix: "", after: "", size: 1000 }
}

/// Keys of all videos as lists show them, and the number of those left out.
async fn video_keys(store: &Store) -> Result<(Vec<String>, usize), StoreError> {
    let listed = store.list_videos(all(), |_, _| true).await?;
    Ok((listed.rows.into_iter().map(|row| row.key).collect(), listed.unreadable))
}

fn trace_record(video: &str) -> serde_json::Value {
    serde_json::json!({ "video": video })
}

#[tokio::test]
async fn a_store_keeps_lists_and_deletes() {
    let folder = tempfile::tempdir().unwrap();
    {
        let store = Store::open(folder.path()).unwrap();
        store.put_video("a", &scene("a", 9)).await.unwrap();
        store.put_of_video(TableKind::Fits, "a", "a/m", &[0.1, f64::INFINITY]).await.unwrap();
        store.put_of_video(TableKind::Stills, "a", "a/stills", &7).await.unwrap();
        store.put_trace("a", "t", &trace_record("a"), 5).await.unwrap();
        store.put_blob("t", Bytes::from_static(b"whole")).await.unwrap();
        store.put_blob("t", Bytes::from_static(b"whole")).await.unwrap();
        let locked = Store::open(folder.path()).err().unwrap();
        assert!(matches!(locked, StoreError::Locked { .. }), "{locked}");
    }
    std::fs::write(folder.path().join("traces/t.mcap#1"), b"ha").unwrap();
    let store = Store::open(folder.path()).unwrap();
    assert_eq!(store.get(TableKind::Fits, "a/m").await.unwrap(), Some([0.1, f64::INFINITY]));
    assert_eq!(store.get(TableKind::Stills, "a/stills").await.unwrap(), Some(7));
    assert_eq!(store.read_blob("t", 1, 3).await.unwrap(), "hol");
    assert!(!folder.path().join("traces/t.mcap#1").exists());
    let shown = store.list_videos(all(), |_, _| true).await.unwrap().rows;
    assert_eq!(shown[0].value, VideoHead::of(&scene("a", 9)));
    assert!(shown[0].created_ms.is_some() && shown[0].value.frames == 9);
    let gone = store.put_of_video(TableKind::Fits, "b", "b/m", &1).await;
    assert_eq!(gone, Err(StoreError::VideoGone));
    assert!(store.delete_video("a").await.unwrap());
    assert!(!store.delete_video("a").await.unwrap());
    assert_eq!(store.stored_bytes(), StoredBytes::default());
    assert_eq!(video_keys(&store).await.unwrap(), (vec![], 0));
    assert_eq!(store.get::<u32>(TableKind::Stills, "a/stills").await.unwrap(), None);
    assert_eq!(store.list(TableKind::Fits, "", "", 9, |_: &f64| true).await.unwrap(), vec![]);
    assert_eq!(store.get::<serde_json::Value>(TableKind::Traces, "t").await.unwrap(), None);
    assert!(store.read_blob("t", 0, 1).await.is_err());
}

#[tokio::test]
async fn a_tenant_sees_and_deletes_its_own_only() {
    let folder = tempfile::tempdir().unwrap();
    let unnamed = Store::open(folder.path()).unwrap();
    let [a, b] = ["a", "b"].map(|name| unnamed.of(&Tenant::new(name).unwrap()));
    for (store, name) in [(&unnamed, "0"), (&a, "1"), (&b, "2")] {
        store.put_video("v", &scene(name, 3)).await.unwrap();
        store.put_trace("v", "t", &trace_record("v"), 5).await.unwrap();
        store.put_blob("t", Bytes::from_static(b"whole")).await.unwrap();
    }
    a.put_video("only", &scene("3", 3)).await.unwrap();
    for (store, names) in [(&unnamed, vec!["0"]), (&a, vec!["3", "1"]), (&b, vec!["2"])] {
        let listed = store.list_videos(all(), |_, _| true).await.unwrap().rows;
        assert_eq!(listed.iter().map(|row| row.value.scene.name.as_str()).collect::<Vec<_>>(), names);
        assert!(listed.iter().all(|row| row.key == "v" || row.key == "only"));
    }
    assert_eq!(b.get::<Scene>(TableKind::Videos, "only").await.unwrap(), None);
    assert_eq!(b.put_of_video(TableKind::Fits, "only", "only/m", &1).await, Err(StoreError::VideoGone));
    assert!(a.delete_video("v").await.unwrap());
    assert!(a.read_blob("t", 0, 1).await.is_err());
    for store in [&unnamed, &b] {
        assert!(store.get::<serde_json::Value>(TableKind::Traces, "t").await.unwrap().is_some());
        assert_eq!(store.read_blob("t", 0, 5).await.unwrap(), "whole");
    }
    let all = unnamed.of_everyone().list(TableKind::Traces, "", "", 9, |_: &serde_json::Value| true).await;
    let keys: Vec<String> = all.unwrap().into_iter().map(|(key, _)| key).collect();
    assert_eq!(keys, ["t", "~b/t"]);
    unnamed.of_everyone().delete_trace("~b/t").await.unwrap();
    assert!(b.read_blob("t", 0, 1).await.is_err() && unnamed.read_blob("t", 0, 1).await.is_ok());
    assert_eq!(["", "A", "a/b", "~a"].map(Tenant::new), [None, None, None, None]);
}

#[tokio::test]
async fn a_page_is_cut_by_rows_and_by_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    store.put_video("v", &scene("v", 3)).await.unwrap();
    for k in 0..5 {
        // Three of them are more than a page holds.
        store.put_of_video(TableKind::Fits, "v", &format!("v/{k}"), &"x".repeat(3 << 20)).await.unwrap();
    }
    let page = async |after: &str, size| {
        let start = PageStart { prefix: "v/", after, size };
        let listed = store.list_page(TableKind::Fits, start, |_: &String, _| true).await.unwrap();
        (listed.rows.into_iter().map(|row| row.key).collect::<Vec<_>>(), listed.next)
    };
    assert_eq!(page("v/", 1).await, (vec!["v/0".to_string()], Some("v/0".to_string())));
    assert_eq!(page("v/", 9).await, (vec!["v/0".to_string(), "v/1".to_string()], Some("v/1".to_string())));
    assert_eq!(page("v/3", 9).await, (vec!["v/4".to_string()], None));
}

#[tokio::test]
async fn a_tenant_stores_no_more_than_its_quota() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    store.put_video("a", &scene("a", 9)).await.unwrap();
    let one = store.stored_bytes().videos;
    drop(store);
    let quota = Quota { video_bytes: Some(2 * one + one / 2), trace_bytes: Some(10) };
    let store = Store::open(folder.path()).unwrap().with_quota(quota);
    assert_eq!(store.stored_bytes().videos, one, "summed when the folder is opened");
    store.put_video("b", &scene("b", 9)).await.unwrap();
    let refused = store.put_video("c", &scene("c", 9)).await;
    let expected =
        StoreError::Quota { kind: "videos", needed_bytes: 3 * one, limit_bytes: 2 * one + one / 2 };
    assert_eq!(refused, Err(expected));
    assert_eq!(video_keys(&store).await.unwrap().0, ["a", "b"]);
    store.put_video("a", &scene("a", 9)).await.unwrap();
    let other = store.of(&Tenant::new("other").unwrap());
    other.put_video("c", &scene("c", 9)).await.unwrap();
    store.delete_video("a").await.unwrap();
    store.put_video("c", &scene("c", 9)).await.unwrap();
    store.admit_trace("t", 10).await.unwrap();
    store.put_trace("c", "t", &trace_record("c"), 10).await.unwrap();
    assert!(matches!(store.admit_trace("u", 1).await, Err(StoreError::Quota { kind: "traces", .. })));
    store.admit_trace("t", 10).await.unwrap();
    store.delete_trace("t").await.unwrap();
    store.admit_trace("u", 1).await.unwrap();
    assert_eq!(other.stored_bytes().videos, one);
    store.put_trace("c", "t", &trace_record("c"), 10).await.unwrap();
    assert_eq!(store.tenants_with_more_traces(9), [(Tenant::default(), 10)]);
    assert_eq!(store.tenants_with_more_traces(10), []);
}

#[tokio::test]
async fn a_trace_without_a_quota_waits_for_no_thread() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let most = store.blocking_permits.available_permits() as u32;
    let _all = store.blocking_permits.acquire_many(most).await.unwrap();
    let admitted = tokio::time::timeout(std::time::Duration::from_secs(20), store.admit_trace("t", 9)).await;
    assert_eq!(admitted.unwrap(), Ok(()));
}

#[test]
fn a_reserve_without_room_at_the_start_is_made_later() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    // No file of this name can be made.
    std::fs::create_dir(folder.path().join("reserve")).unwrap();
    assert!(store.keep_reserve(4096).is_err());
    assert!(store.lacks_reserve() && !store.storage().is_full);
    std::fs::remove_dir(folder.path().join("reserve")).unwrap();
    store.rebuild_reserve().unwrap();
    assert!(!store.lacks_reserve());
    assert_eq!(std::fs::metadata(folder.path().join("reserve")).unwrap().len(), 4096);
}

#[tokio::test]
async fn a_scan_ends_when_its_caller_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for k in 0..9 {
        store.put_lexicon(&format!("{k}"), &k).await.unwrap();
    }
    let ((has_started, started), (go_on, may_go_on)) = (mpsc::channel(), mpsc::channel::<()>());
    let (scan, seen) = (store.clone(), Arc::new(AtomicUsize::new(0)));
    let count = seen.clone();
    let scan = tokio::spawn(async move {
        let step = move |_: &mut (), _: TimedRow<i32>| {
            if count.fetch_add(1, Ordering::SeqCst) == 0 {
                has_started.send(()).unwrap();
                may_go_on.recv().unwrap();
            }
            ControlFlow::Continue(())
        };
        scan.fold(TableKind::Lexica, ("", ""), (), step).await
    });
    tokio::task::spawn_blocking(move || started.recv().unwrap()).await.unwrap();
    scan.abort();
    assert!(scan.await.unwrap_err().is_cancelled());
    go_on.send(()).unwrap();
    // All permits are there again when it has ended.
    let _all = store.blocking_permits.acquire_many(8).await.unwrap();
    assert_eq!(seen.load(Ordering::SeqCst), 1);
}

#[tokio::test]
async fn files_without_records_are_found_and_removed() {
    let folder = tempfile::tempdir().unwrap();
    {
        let store = Store::open(folder.path()).unwrap();
        let tenant = store.of(&Tenant::new("lab").unwrap());
        for store in [&store, &tenant] {
            store.put_video("v", &scene("v", 3)).await.unwrap();
            for (id, is_recorded) in [("kept", true), ("left", false)] {
                store.put_blob(id, Bytes::from_static(b"whole")).await.unwrap();
                if is_recorded {
                    store.put_trace("v", id, &trace_record("v"), 5).await.unwrap();
                }
            }
        }
        // Killed here: between file and record.
    }
    let store = Store::open(folder.path()).unwrap();
    std::fs::write(folder.path().join("traces/notes.txt"), b"not ours").unwrap();
    let mut orphans = store.orphans().await.unwrap();
    orphans.sort();
    assert_eq!(orphans, ["left", "~lab/left"]);
    for key in orphans {
        assert!(store.delete_orphan(&key).await.unwrap());
    }
    assert!(!store.delete_orphan("~lab/kept").await.unwrap());
    assert_eq!(store.orphans().await.unwrap(), Vec::<String>::new());
    let mut left: Vec<String> = std::fs::read_dir(folder.path().join("traces"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["kept.mcap", "lab.kept.mcap", "notes.txt"]);
}

#[test]
fn a_folder_that_cannot_be_used_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let error = Store::open(&file).err().unwrap().to_string();
    assert!(error.contains(&file.display().to_string()) && error.contains("--data-dir"), "{error}");
}
