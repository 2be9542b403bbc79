//! The tables of the database.

use redb::TableDefinition;

pub type RowTable = TableDefinition<'static, &'static str, &'static [u8]>;
pub type NumberTable = TableDefinition<'static, &'static str, u64>;

/// The schema version.
pub const META: NumberTable = TableDefinition::new("meta");
/// Until schema 1: when rows were stored first (milliseconds after 1970), by `{table}/{key}`.
pub const TIMES: NumberTable = TableDefinition::new("times");
/// Bytes of the results of operations, by the operation's key.
pub const OPERATION_RESULTS: RowTable = TableDefinition::new("operation_results");
/// The head of each row, by `{table}/{key}`: what lists need, and the second place that names the row's key.
pub const HEADS: RowTable = TableDefinition::new("heads");

/// A table of CBOR values: fields have names as in JSON, and infinite bounds can be stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableKind {
    /// By video id.
    Videos,
    /// By `{video}/{model}`.
    Fits,
    /// By `{first video}/{study}`.
    Studies,
    /// By `{video}/stills`: frames of the video file as pictures.
    Stills,
    /// By trace id; the value has a `video`.
    Traces,
    /// By operation id; the value has `videos`.
    Operations,
    /// By lexicon id.
    Lexica,
    /// By `{first video}/{study}/{step}`: results of a discovery that runs.
    Checkpoints,
}

pub const TABLES: [TableKind; 8] = [
    TableKind::Videos,
    TableKind::Fits,
    TableKind::Studies,
    TableKind::Stills,
    TableKind::Traces,
    TableKind::Operations,
    TableKind::Lexica,
    TableKind::Checkpoints,
];

/// All tables of bytes; the heads, which older schemas lack, are the last.
pub fn row_tables() -> impl Iterator<Item = RowTable> {
    TABLES.map(TableKind::table).into_iter().chain([OPERATION_RESULTS, HEADS])
}

impl TableKind {
    pub fn table(self) -> RowTable {
        TableDefinition::new(self.name())
    }

    pub fn name(self) -> &'static str {
        match self {
            TableKind::Videos => "videos",
            TableKind::Fits => "fits",
            TableKind::Studies => "studies",
            TableKind::Stills => "stills",
            TableKind::Traces => "traces",
            TableKind::Operations => "operations",
            TableKind::Lexica => "lexica",
            TableKind::Checkpoints => "checkpoints",
        }
    }

    /// The key of the head of one of its rows; errors name a row so.
    pub fn head_key(self, key: &str) -> String {
        format!("{}/{key}", self.name())
    }
}

/// The first text after all that start with `prefix`; `None`: there is none.
pub fn after_prefix(prefix: &str) -> Option<String> {
    let last = prefix.char_indices().rev().find_map(|(at, c)| {
        let next = (c as u32 + 1..=char::MAX as u32).find_map(char::from_u32)?;
        Some((at, next))
    });
    last.map(|(at, next)| format!("{}{next}", &prefix[..at]))
}
