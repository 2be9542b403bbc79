//! A disk without space.

use super::*;

#[tokio::test]
async fn deletions_work_on_a_full_disk_and_nothing_else_takes_their_space() {
    let folder = tempfile::tempdir().unwrap();
    let disk = MemoryDisk::default();
    {
        let mut faults = disk.faults.lock().unwrap();
        faults.reserve = Some(folder.path().join("reserve"));
        faults.pages = Some(1 << 30);
    }
    let of = disk.clone();
    let store = Store::opened(folder.path(), move |_| database(of.clone()), migrate).unwrap();
    store.keep_reserve(1 << 20).unwrap();
    for k in 0..110 {
        store.put_video(&format!("v{k}"), &scene("v", 40)).await.unwrap();
        store.put_of_video(TableKind::Fits, &format!("v{k}"), &format!("v{k}/m"), &k).await.unwrap();
    }
    // Nothing more fits, not even in pages that were freed: those are all written again.
    disk.faults.lock().unwrap().pages = Some(disk.used() + 256);
    let mut refused = 0;
    for k in 110..10_000 {
        match store.put_video(&format!("v{k}"), &scene("v", 400)).await {
            Ok(()) => {}
            Err(error) => {
                assert_eq!(error, StoreError::Full);
                refused += 1;
                if refused == 3 {
                    break;
                }
            }
        }
    }
    assert_eq!(refused, 3);
    assert!(!store.storage().is_full, "the reserve is for deletions");
    let mut deleted = 0;
    for k in 0..100 {
        assert!(store.delete_video(&format!("v{k}")).await.unwrap(), "{k}");
        deleted += 1;
        // What others would take is still there for the next deletion.
        if store.storage().is_full {
            let taken = store.put_video("w", &scene("w", 400)).await;
            assert!(matches!(taken, Ok(()) | Err(StoreError::Full)), "{taken:?}");
        }
    }
    assert_eq!(deleted, 100);
    let (left, unreadable) = video_keys(&store).await.unwrap();
    assert!(unreadable == 0 && left.contains(&"v100".to_string()) && !left.contains(&"v99".to_string()));
    disk.faults.lock().unwrap().pages = None;
    store.rebuild_reserve().unwrap();
    assert!(!store.storage().is_full);
    store.put_video("w", &scene("w", 400)).await.unwrap();
}
