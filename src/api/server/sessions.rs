//! Browsers that have logged in: a cookie names a session, and a session stands for a token while the token is valid.

use super::auth::TokenDigest;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a login lasts: a working day.
pub const SESSION: Duration = Duration::from_secs(12 * 3600);
/// Most sessions; beyond it the oldest ends.
const MAX_SESSIONS: usize = 1000;

#[derive(Default)]
pub struct Sessions(Mutex<BTreeMap<[u8; 32], LoginSession>>);

struct LoginSession {
    token: TokenDigest,
    since: Instant,
}

impl Sessions {
    /// No code panics while it holds this lock.
    fn all(&self) -> MutexGuard<'_, BTreeMap<[u8; 32], LoginSession>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts a session and returns its secret name; `None` if the system gives no random bytes.
    pub fn start(&self, token: TokenDigest) -> Option<String> {
        let name = random_name()?;
        let mut all = self.all();
        all.retain(|_, session| session.since.elapsed() < SESSION);
        if all.len() >= MAX_SESSIONS
            && let Some(oldest) = all.iter().min_by_key(|(_, session)| session.since).map(|(key, _)| *key)
        {
            all.remove(&oldest);
        }
        all.insert(key(&name), LoginSession { token, since: Instant::now() });
        Some(name)
    }

    /// The token of a session that has not ended.
    pub fn token(&self, name: &str) -> Option<TokenDigest> {
        let all = self.all();
        all.get(&key(name)).filter(|session| session.since.elapsed() < SESSION).map(|session| session.token)
    }

    pub fn end(&self, name: &str) {
        self.all().remove(&key(name));
    }
}

/// Sessions are known by digests: the duration of a look-up reveals nothing about a name.
fn key(name: &str) -> [u8; 32] {
    blake3::hash(name.as_bytes()).into()
}

/// 256 random bits as text.
pub fn random_name() -> Option<String> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).ok()?;
    Some(blake3::Hash::from_bytes(bytes).to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_stands_for_its_token_until_it_ends() {
        let sessions = Sessions::default();
        let (mine, other) = (sessions.start([1; 32]).unwrap(), sessions.start([2; 32]).unwrap());
        assert!(mine != other && sessions.token(&mine) == Some([1; 32]) && sessions.token("x").is_none());
        sessions.end(&mine);
        assert_eq!((sessions.token(&mine), sessions.token(&other)), (None, Some([2; 32])));
        for _ in 0..MAX_SESSIONS {
            sessions.start([3; 32]).unwrap();
        }
        assert!(sessions.all().len() == MAX_SESSIONS && sessions.token(&other).is_none());
    }
}
