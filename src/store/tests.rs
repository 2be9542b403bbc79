//! The store on real folders.

use super::*;

#[tokio::test]
async fn a_store_keeps_lists_and_deletes() {
    let folder = tempfile::tempdir().unwrap();
    {
        let store = Store::open(folder.path()).unwrap();
        store.put_video("a", &1.5).await.unwrap();
        store.put_of_video(TableKind::Fits, "a", "a/m", &[0.1, f64::INFINITY]).await.unwrap();
        store.put_of_video(TableKind::Stills, "a", "a/stills", &7).await.unwrap();
        store.put_of_video(TableKind::Traces, "a", "t", &serde_json::json!({"video": "a"})).await.unwrap();
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
    let gone = store.put_of_video(TableKind::Fits, "b", "b/m", &1).await;
    assert_eq!(gone, Err(StoreError::VideoGone));
    assert!(store.delete_video("a").await.unwrap());
    assert!(!store.delete_video("a").await.unwrap());
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
    for (store, value) in [(&unnamed, 0), (&a, 1), (&b, 2)] {
        store.put_video("v", &value).await.unwrap();
        let trace = serde_json::json!({ "video": "v" });
        store.put_of_video(TableKind::Traces, "v", "t", &trace).await.unwrap();
        store.put_blob("t", Bytes::from_static(b"whole")).await.unwrap();
    }
    a.put_video("only", &3).await.unwrap();
    for (store, values) in [(&unnamed, vec![0]), (&a, vec![3, 1]), (&b, vec![2])] {
        let listed = store.list(TableKind::Videos, "", "", 9, |_: &i32| true).await.unwrap();
        assert_eq!(listed.iter().map(|(_, v)| *v).collect::<Vec<_>>(), values);
        assert!(listed.iter().all(|(key, _)| key == "v" || key == "only"));
    }
    assert_eq!(b.get::<i32>(TableKind::Videos, "only").await.unwrap(), None);
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

#[test]
fn a_folder_that_cannot_be_used_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let error = Store::open(&file).err().unwrap().to_string();
    assert!(error.contains(&file.display().to_string()) && error.contains("--data-dir"), "{error}");
}

#[test]
fn a_newer_schema_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    drop(Store::open(folder.path()).unwrap());
    let db = Database::create(folder.path().join("vrdp.redb")).unwrap();
    let write = db.begin_write().unwrap();
    write.open_table(META).unwrap().insert("schema", SCHEMA_VERSION + 1).unwrap();
    write.commit().unwrap();
    drop(db);
    let file = || std::fs::read(folder.path().join("vrdp.redb")).unwrap();
    let before = file();
    assert!(matches!(Store::open(folder.path()), Err(StoreError::Newer { found: 2, known: 1, .. })));
    assert!(file() == before);
}

#[tokio::test]
async fn a_damaged_row_is_reported_and_hides_no_other_row() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for (key, value) in [("a", 1.5), ("b", 2.5)] {
        store.put_video(key, &value).await.unwrap();
    }
    let change = |row: Vec<u8>| {
        let open = store.db.open.read().unwrap();
        let write = open.as_ref().unwrap().begin_write().unwrap();
        write.open_table(TableKind::Videos.table()).unwrap().insert("a", &*row).unwrap();
        write.commit().unwrap();
    };
    let row = encode(&1.5).unwrap();
    for bit in 0..8 * row.len() {
        let mut flipped = row.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        change(flipped);
        let found = store.get::<f64>(TableKind::Videos, "a").await;
        assert_eq!(found, Err(StoreError::Damaged { key: "a".into() }), "{bit}");
    }
    let listed = store.list(TableKind::Videos, "", "", 9, |_: &f64| true).await.unwrap();
    assert_eq!(listed, [("b".to_string(), 2.5)]);
    // As an older program wrote it.
    change(row[..row.len() - 4].to_vec());
    assert_eq!(store.get(TableKind::Videos, "a").await.unwrap(), Some(1.5));
}
