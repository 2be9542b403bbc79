//! Schemas: folders of older programs, of newer ones, and of interrupted ones.

use super::*;
use crate::store::schema::migrations::schema_of;
use crate::store::schema::tables::{HEADS, TABLES, TIMES};
use redb::ReadableTableMetadata;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Schemas of which a folder is kept, with two tenants; its process was killed. These must stay as they are for ever.
const OLD: [u64; SCHEMA_VERSION as usize - 1] = [1, 2];

fn kept(schema: u64) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/folder_schema_{schema}"))
}

fn copied(schema: u64, to: &Path) {
    let from = kept(schema);
    std::fs::create_dir_all(to.join("traces")).unwrap();
    std::fs::copy(from.join("vrdp.redb"), to.join("vrdp.redb")).unwrap();
    for entry in std::fs::read_dir(from.join("traces")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join("traces").join(entry.file_name())).unwrap();
    }
}

/// What the old folder holds: videos, models and traces of the unnamed tenant, and of `lab`.
async fn is_whole(store: &Store) {
    for (tenant, counts) in [(Tenant::default(), [2, 2, 3]), (Tenant::new("lab").unwrap(), [1, 1, 1])] {
        let store = store.of(&tenant);
        let videos = store.list_videos(all(), |_, _| true).await.unwrap();
        for row in &videos.rows {
            let whole = store.get::<Scene>(TableKind::Videos, &row.key).await.unwrap().unwrap();
            assert_eq!(row.value, VideoHead::of(&whole));
            assert!(row.created_ms.is_some() && whole.digest() == row.key);
        }
        let keep = |_: &serde_json::Value, _| true;
        let models = store.list_page(TableKind::Fits, all(), keep).await.unwrap();
        assert!(models.rows.iter().all(|row| row.created_ms.is_some()));
        let traces = store.list_page(TableKind::Traces, all(), keep).await.unwrap();
        let found = [videos.rows.len(), models.rows.len(), traces.rows.len()];
        assert_eq!((found, videos.unreadable + models.unreadable + traces.unreadable), (counts, 0));
        let files: u64 = traces.rows.iter().map(|row| row.value["size_bytes"].as_u64().unwrap()).sum();
        assert!(store.stored_bytes().traces == files && store.stored_bytes().videos > 0);
    }
    assert_eq!(store.check().unwrap().faults, []);
}

#[tokio::test]
async fn folders_of_older_schemas_are_migrated_and_whole() {
    for schema in OLD {
        let folder = tempfile::tempdir().unwrap();
        copied(schema, folder.path());
        {
            let unchanged = Store::open_unchanged(folder.path()).unwrap();
            assert_eq!(unchanged.check().unwrap().faults, [], "schema {schema}");
            assert_eq!(unchanged.db.run(schema_of).unwrap(), Some(schema));
            let mut archive = vec![];
            unchanged.backup(&mut archive).unwrap();
            let restored = folder.path().join("restored");
            restore(archive.as_slice(), &restored).unwrap();
            is_whole(&Store::open(&restored).unwrap()).await;
        }
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(store.db.run(schema_of).unwrap(), Some(SCHEMA_VERSION));
        is_whole(&store).await;
    }
}

#[tokio::test]
async fn a_migration_that_is_killed_at_any_write_goes_on_at_the_next_start() {
    for schema in OLD {
        let found = killed_migrations(schema).await;
        assert_eq!(found, (schema..=SCHEMA_VERSION).collect(), "from schema {schema}");
    }
}

/// Kills the migration from a schema after each write; the schemas that were left.
async fn killed_migrations(schema: u64) -> BTreeSet<u64> {
    let old = std::fs::read(kept(schema).join("vrdp.redb")).unwrap();
    let open = |disk: &MemoryDisk, folder: &Path| {
        copied(schema, folder);
        let disk = disk.clone();
        Store::opened(folder, move |_| database(disk.clone()), migrate)
    };
    let mut left = BTreeSet::new();
    for writes in 0..10_000 {
        let disk = MemoryDisk::of(old.clone());
        disk.faults.lock().unwrap().writes = Some(writes);
        let folder = tempfile::tempdir().unwrap();
        let killed = open(&disk, folder.path()).is_err();
        // The process is gone: what was not written never will be.
        let rest = MemoryDisk::of(disk.image());
        let found = database(rest.clone()).map(|db| schema_of(&db).unwrap());
        left.insert(found.unwrap().unwrap_or_else(|| panic!("after {writes} writes")));
        let rest = MemoryDisk::of(disk.image());
        is_whole(&open(&rest, folder.path()).unwrap()).await;
        if !killed {
            break;
        }
    }
    left
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
    let newer = Store::open(folder.path()).err().unwrap();
    assert!(matches!(newer, StoreError::Newer { found, .. } if found == SCHEMA_VERSION + 1), "{newer}");
    assert!(file() == before);
}

#[test]
fn a_missing_database_beside_traces_is_refused() {
    for is_empty in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        copied(1, folder.path());
        let database = folder.path().join("vrdp.redb");
        match is_empty {
            true => std::fs::write(&database, b"").unwrap(),
            false => std::fs::remove_file(&database).unwrap(),
        }
        let refused = Store::open(folder.path()).err().unwrap();
        assert!(matches!(refused, StoreError::DatabaseGone { .. }), "{refused}");
        assert!(refused.to_string().contains("vrdp data restore"), "{refused}");
    }
}

#[test]
fn the_times_of_rows_stand_in_their_heads() {
    let folder = tempfile::tempdir().unwrap();
    copied(1, folder.path());
    let store = Store::open(folder.path()).unwrap();
    let counted = |db: &Database| {
        let read = db.begin_read().unwrap();
        assert!(read.open_table(TIMES).is_err());
        let rows = TABLES.map(|kind| read.open_table(kind.table()).unwrap().len().unwrap());
        Ok((rows.iter().sum::<u64>(), read.open_table(HEADS).unwrap().len().unwrap()))
    };
    let (rows, heads) = store.db.run(counted).unwrap();
    assert!(rows == heads && rows > 8, "{rows} rows, {heads} heads");
}
