//! The login of a browser: a token once in a form, then a cookie that stands for it.

use super::pages::page;
use super::visitor::Visitor;
use crate::api::server::auth::digest;
use crate::api::server::sessions::SESSION;
use crate::report::login::{logged_in, login};
use axum::Extension;
use axum::extract::{Query, Request};
use axum::http::header::{ACCEPT, COOKIE, HOST, LOCATION, ORIGIN, SET_COOKIE, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use std::time::Duration;

/// The cookie of a session.
const COOKIE_NAME: &str = "vrdp_session";
/// Most bytes of the form, and the longest time in which they must arrive.
const MAX_FORM: usize = 8 * 1024;
const FORM_TIMEOUT: Duration = Duration::from_secs(10);

#[derive(Deserialize)]
struct LoginForm {
    token: String,
    #[serde(default)]
    next: String,
}

/// The name of the session that a request's cookie holds.
pub fn session_name(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(COOKIE).iter().filter_map(|line| line.to_str().ok());
    let mut pairs = cookies.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value)
}

/// What a visitor without a token gets: a browser the form, a program the advice.
pub fn asked(request: &Request) -> Response {
    let accepts = request.headers().get(ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
    if accepts.contains("text/html") {
        let next = request.uri().path_and_query().map_or("/", |path| path.as_str());
        return (StatusCode::UNAUTHORIZED, page(login(place(next), None))).into_response();
    }
    let advice = "send the header authorization: Bearer TOKEN, or log in at /login\n";
    (StatusCode::UNAUTHORIZED, [(WWW_AUTHENTICATE, "Bearer")], advice).into_response()
}

pub async fn show(Extension(visitor): Extension<Visitor>) -> Response {
    match &visitor.tenant {
        _ if visitor.context.security.current().tokens.is_none() => {
            (StatusCode::NOT_FOUND, "this service needs no token\n").into_response()
        }
        Some(tenant) => page(logged_in(tenant.name())),
        None => page(login("/", None)),
    }
}

pub async fn log_in(Extension(visitor): Extension<Visitor>, request: Request) -> Response {
    if is_foreign(request.headers()) {
        return (StatusCode::FORBIDDEN, "the form is of another site\n").into_response();
    }
    let read = axum::body::to_bytes(request.into_body(), MAX_FORM);
    let Ok(Ok(body)) = tokio::time::timeout(FORM_TIMEOUT, read).await else {
        return (StatusCode::BAD_REQUEST, "the form is too long, or came too slowly\n").into_response();
    };
    let Some(form) = std::str::from_utf8(&body).ok().and_then(fields) else {
        return (StatusCode::BAD_REQUEST, "the form has no token\n").into_response();
    };
    let (security, token) = (visitor.context.security.current(), digest(form.token.trim()));
    let Some(tenant) = security.tokens.as_ref().and_then(|tokens| tokens.of_digest(&token)) else {
        tracing::warn!("a login with a token that the service does not know");
        let problem = "The service does not know this token.";
        return (StatusCode::UNAUTHORIZED, page(login(place(&form.next), Some(problem)))).into_response();
    };
    let Some(name) = visitor.context.sessions.start(token) else {
        return (StatusCode::INTERNAL_SERVER_ERROR, "the system gives no random numbers\n").into_response();
    };
    tracing::info!(tenant = tenant.name(), "logged in");
    let cookie = cookie(&name, SESSION.as_secs(), visitor.is_encrypted);
    let to = place(&form.next).to_string();
    (StatusCode::SEE_OTHER, [(SET_COOKIE, cookie), (LOCATION, to)]).into_response()
}

pub async fn log_out(Extension(visitor): Extension<Visitor>, headers: HeaderMap) -> Response {
    if let Some(name) = session_name(&headers) {
        visitor.context.sessions.end(name);
    }
    let gone = cookie("", 0, visitor.is_encrypted);
    (StatusCode::SEE_OTHER, [(SET_COOKIE, gone), (LOCATION, "/login".to_string())]).into_response()
}

/// No script reads it, no other site sends it, and where there is encryption it is never sent without.
fn cookie(value: &str, seconds: u64, is_encrypted: bool) -> String {
    let secure = if is_encrypted { "; Secure" } else { "" };
    format!("{COOKIE_NAME}={value}; Path=/; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}")
}

/// A form is written as the query of an address is.
fn fields(body: &str) -> Option<LoginForm> {
    let address: Uri = format!("/?{body}").parse().ok()?;
    Query::<LoginForm>::try_from_uri(&address).ok().map(|Query(form)| form)
}

/// A path of this service, or its first page.
fn place(next: &str) -> &str {
    let is_path = next.starts_with('/') && !next.starts_with("//") && !next.contains(['\\', '\r', '\n']);
    if is_path && next.is_ascii() { next } else { "/" }
}

/// Whether a form was sent by a page of another site.
fn is_foreign(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(ORIGIN) else { return false };
    let of = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, authority)| authority);
    of.is_none() || of != headers.get(HOST).and_then(|host| host.to_str().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_login_leads_to_a_page_of_this_service() {
        for (next, to) in [
            ("/videos/a/report?with=b", "/videos/a/report?with=b"),
            ("//evil.example", "/"),
            ("https://evil.example", "/"),
            ("/\\evil.example", "/"),
            ("", "/"),
        ] {
            assert_eq!(place(next), to, "{next}");
        }
    }

    #[test]
    fn forms_and_cookies_are_read() {
        let form = fields("token=a%2Bb%3D%3D&next=%2Fx").unwrap();
        assert_eq!((form.token.as_str(), form.next.as_str()), ("a+b==", "/x"));
        assert!(fields("next=%2Fx").is_none() && fields("\u{7f}").is_none());
        let headers = |value: &str| HeaderMap::from_iter([(COOKIE, value.parse().unwrap())]);
        assert_eq!(session_name(&headers("a=b; vrdp_session=xy; c=d")), Some("xy"));
        assert_eq!(session_name(&headers("vrdp_sessions=xy")), None);
    }
}
