//! The owner of rows: the tenant is the start of every key.

use std::sync::Arc;

/// The owner of rows: each tenant has rows of its own in the same folder. The default is the unnamed tenant.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tenant {
    /// The start of every key. `~` sorts after all characters of ids, so that the rows of a tenant follow those without a name.
    prefix: Arc<str>,
}

impl Default for Tenant {
    fn default() -> Self {
        Tenant { prefix: "".into() }
    }
}

impl Tenant {
    /// A name of 1 to 40 of `a-z`, `0-9`, `-` and `_`.
    pub fn new(name: &str) -> Option<Tenant> {
        let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'_';
        let fine = (1..=40).contains(&name.len()) && name.bytes().all(plain);
        fine.then(|| Tenant { prefix: format!("~{name}/").into() })
    }

    /// The owner of the row with this whole key.
    pub(crate) fn of_key(key: &str) -> Tenant {
        let end = if key.starts_with('~') { key.find('/').map_or(0, |at| at + 1) } else { 0 };
        Tenant { prefix: key[..end].into() }
    }

    pub fn is_unnamed(&self) -> bool {
        self.prefix.is_empty()
    }

    /// Its name; empty for the unnamed tenant.
    pub fn name(&self) -> &str {
        self.prefix.trim_start_matches('~').trim_end_matches('/')
    }

    /// The start of every key of its rows.
    pub(super) fn prefix(&self) -> &str {
        &self.prefix
    }
}
