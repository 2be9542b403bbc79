//! Authentication: bearer tokens, each of one tenant. Without tokens all callers are the same, unnamed tenant.

use super::connections::tls::Tls;
use crate::api::status::plain;
use crate::engine::Tenant;
use futures_util::future::{Either, Ready, ready};
use http::header::AUTHORIZATION;
use http::{HeaderMap, Request, Response};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::task::{Context, Poll};
use tonic::body::Body;
use tonic::{Code, Status};
use tower::{Layer, Service};

/// Shortest token: a shorter one can be guessed.
const MIN_TOKEN: usize = 16;
/// Health checks need no token.
const OPEN_PREFIX: &str = "/grpc.health.v1.Health/";

/// How a service is secured; by default not at all.
#[derive(Clone, Default)]
pub struct Security {
    /// Certificate and key, and the authority that signs clients' certificates, if they need one.
    pub tls: Option<Tls>,
    pub tokens: Option<Arc<Tokens>>,
}

/// The security of a running service: its certificate and its tokens may be replaced while it runs.
#[derive(Clone, Default)]
pub struct LiveSecurity(Arc<RwLock<Arc<Security>>>);

impl From<Security> for LiveSecurity {
    fn from(security: Security) -> Self {
        LiveSecurity(Arc::new(RwLock::new(Arc::new(security))))
    }
}

impl LiveSecurity {
    /// What holds now.
    pub fn current(&self) -> Arc<Security> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What holds for every later call and connection.
    pub fn replace(&self, security: Security) {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(security);
    }
}

/// The tenant of a call, once it is known; whoever logs the call has the other end.
#[derive(Clone, Default)]
pub struct KnownTenant(pub Arc<OnceLock<Tenant>>);

/// The digest of a token.
pub type TokenDigest = [u8; 32];

/// Tenants by the digests of their tokens: the duration of a look-up reveals nothing about a token.
#[derive(Default)]
pub struct Tokens(BTreeMap<TokenDigest, Tenant>);

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line} {problem}; write lines of TOKEN = TENANT")]
pub struct TokenError {
    pub line: usize,
    pub problem: &'static str,
}

impl Tokens {
    /// Reads lines of `TOKEN = TENANT`; empty ones and comments (`#`) are skipped. No error contains a token.
    pub fn parse(text: &str) -> Result<Tokens, TokenError> {
        let mut found = BTreeMap::new();
        for (k, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let wrong = |problem| TokenError { line: k + 1, problem };
            // A token may end in `=`.
            let (token, tenant) = line.rsplit_once('=').ok_or(wrong("has no tenant"))?;
            let (token, tenant) = (token.trim(), tenant.trim());
            if token.len() < MIN_TOKEN || !token.bytes().all(|b| b.is_ascii_graphic()) {
                return Err(wrong("has a token of less than 16 characters, or of others than visible ASCII"));
            }
            let tenant = Tenant::new(tenant)
                .ok_or(wrong("has a tenant that is not 1 to 40 of a-z, 0-9, '-' and '_'"))?;
            if found.insert(digest(token), tenant).is_some() {
                return Err(wrong("repeats a token"));
            }
        }
        if found.is_empty() {
            Err(TokenError { line: 1, problem: "is the last: there is no token" })
        } else {
            Ok(Tokens(found))
        }
    }

    /// The tenant of the token in the header.
    pub fn tenant(&self, headers: &HeaderMap) -> Option<&Tenant> {
        let (scheme, token) = headers.get(AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
        if !scheme.eq_ignore_ascii_case("bearer") {
            return None;
        }
        self.of_digest(&digest(token.trim()))
    }

    /// The tenant of the token with this digest.
    pub fn of_digest(&self, digest: &TokenDigest) -> Option<&Tenant> {
        self.0.get(digest)
    }
}

/// The digest by which a token is known.
pub fn digest(token: &str) -> TokenDigest {
    blake3::hash(token.as_bytes()).into()
}

/// The layer: hands the caller's tenant to the services, or refuses the call.
#[derive(Clone)]
pub struct AuthLayer(pub LiveSecurity);

impl<S> Layer<S> for AuthLayer {
    type Service = Authenticated<S>;

    fn layer(&self, inner: S) -> Authenticated<S> {
        Authenticated { inner, security: self.0.clone() }
    }
}

#[derive(Clone)]
pub struct Authenticated<S> {
    inner: S,
    security: LiveSecurity,
}

impl<S, B> Service<Request<B>> for Authenticated<S>
where
    S: Service<Request<B>, Response = Response<Body>>,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Either<S::Future, Ready<Result<Response<Body>, S::Error>>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<B>) -> Self::Future {
        if let Some(tokens) = &self.security.current().tokens
            && !request.uri().path().starts_with(OPEN_PREFIX)
        {
            match tokens.tenant(request.headers()).cloned() {
                Some(tenant) => {
                    if let Some(known) = request.extensions().get::<KnownTenant>() {
                        // Set once: a call has one token.
                        let _ = known.0.set(tenant.clone());
                    }
                    request.extensions_mut().insert(tenant);
                }
                None => return Either::Right(ready(Ok(refusal().into_http()))),
            }
        }
        Either::Left(self.inner.call(request))
    }
}

fn refusal() -> Status {
    let message = "no valid token; send the header authorization: Bearer TOKEN (on the command line: --token FILE, a file with a token that the service knows)";
    plain(Code::Unauthenticated, message.into(), "UNAUTHENTICATED")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, expected: Result<usize, (usize, &str)>) {
        match (Tokens::parse(text), expected) {
            (Ok(tokens), Ok(count)) => assert_eq!(tokens.0.len(), count),
            (Err(error), Err((line, problem))) => {
                assert!(error.line == line && error.problem.contains(problem), "{error}");
                assert!(!error.to_string().contains("secret"));
            }
            (found, _) => panic!("{text}: {:?}", found.map(|t| t.0.len())),
        }
    }

    #[test]
    fn token_files_are_read_or_refused() {
        check("# ours\n\nsecret-of-lab-a-0== = lab-a\nsecret-of-lab-b-00=lab_b\n", Ok(2));
        check("", Err((1, "no token")));
        check("secret-of-lab-a-00", Err((1, "no tenant")));
        check("secret = lab", Err((1, "less than 16")));
        check("secret-of-lab-a-00 = Lab A", Err((1, "tenant")));
        check("secret-of-lab-a-00 = a\nsecret-of-lab-a-00 = b", Err((2, "repeats")));
    }

    #[test]
    fn a_token_opens_one_tenant() {
        let tokens = Tokens::parse("secret-of-lab-a-0== = lab-a").unwrap();
        let tenant = |value: &str| {
            let headers = HeaderMap::from_iter([(AUTHORIZATION, value.parse().unwrap())]);
            tokens.tenant(&headers).cloned()
        };
        assert_eq!(tenant("bearer secret-of-lab-a-0=="), Tenant::new("lab-a"));
        for wrong in ["Bearer secret-of-lab-a-0=", "Basic secret-of-lab-a-0==", "Bearer ", "Bearer lab-a"] {
            assert_eq!(tenant(wrong), None, "{wrong}");
        }
    }
}
