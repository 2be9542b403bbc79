//! Heads: the little that lists, quotas and searches need of a row, stored beside it in the same transaction.

use super::rows;
use super::tables::TableKind;
use crate::scene::{Object, Scene};
use crate::store::error::{StoreError, failed};
use redb::ReadableTable;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};

/// What lists show of a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VideoHead {
    /// Without samples, times, outliers and features.
    pub scene: Scene,
    pub frames: usize,
    /// Time of the last frame (s).
    pub seconds: f64,
}

impl VideoHead {
    pub fn of(scene: &Scene) -> VideoHead {
        let bare = |object: &Object| Object {
            id: object.id,
            color: object.color.clone(),
            material: object.material.clone(),
            shape: object.shape,
            mass: object.mass,
            features: vec![],
        };
        let outline = Scene {
            name: scene.name.clone(),
            setup: scene.setup.clone(),
            world: scene.world,
            fps: scene.fps,
            times: vec![],
            camera: scene.camera,
            table: scene.table,
            noise_sigma: scene.noise_sigma,
            objects: scene.objects.iter().map(bare).collect(),
            absent: scene.absent.iter().map(bare).collect(),
            tracks: vec![],
            outliers: vec![],
            findings: scene.findings.clone(),
            feature_layout: scene.feature_layout.clone(),
        };
        VideoHead {
            scene: outline,
            frames: scene.times.len(),
            seconds: scene.times.last().copied().unwrap_or_default(),
        }
    }
}

/// The head of a row. What it shows is a `VideoHead` for a video, and nothing for other rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RowHead<T> {
    /// When the row was stored first (milliseconds after 1970); rows of the first programs have none.
    pub created_ms: Option<u64>,
    /// Bytes that count towards the tenant's quota: of the row, or of a trace's file.
    pub bytes: u64,
    #[serde(default = "nothing")]
    pub shown: Option<T>,
}

fn nothing<T>() -> Option<T> {
    None
}

/// The head of a row that shows nothing, or of which only the bytes and the time are read.
pub type PlainHead = RowHead<IgnoredAny>;

impl<T: DeserializeOwned> RowHead<T> {
    /// Reads the head under this key of `HEADS`.
    pub fn read(head_key: &str, row: &[u8]) -> Option<RowHead<T>> {
        // Heads have always had the checksum of their key: one without is damaged.
        rows::value(rows::unsealed(head_key, row)?)
    }

    /// The head under this key; one that is damaged is none.
    pub fn of(
        heads: &impl ReadableTable<&'static str, &'static [u8]>,
        head_key: &str,
    ) -> Result<Option<RowHead<T>>, StoreError> {
        let row = heads.get(head_key).map_err(failed)?;
        Ok(row.and_then(|row| RowHead::read(head_key, row.value())))
    }
}

/// The field of a trace's record that counts towards the quota.
#[derive(Deserialize)]
struct SizedTrace {
    #[serde(default)]
    size_bytes: u64,
}

/// The bytes of the head of a row of schema 1; `None`: the row is damaged, and has a head that shows nothing.
pub fn head_of_row(kind: TableKind, key: &str, row: &[u8], created_ms: Option<u64>) -> Vec<u8> {
    let head_key = kind.head_key(key);
    let (bytes, shown) = match kind {
        TableKind::Videos => {
            (row.len() as u64, rows::readable::<Scene>(key, row).map(|scene| VideoHead::of(&scene)))
        }
        TableKind::Traces => (rows::readable::<SizedTrace>(key, row).map_or(0, |r| r.size_bytes), None),
        _ => (row.len() as u64, None),
    };
    let head = RowHead { created_ms, bytes, shown };
    rows::encode(&head_key, &head).unwrap_or_default()
}
