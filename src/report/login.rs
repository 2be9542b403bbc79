//! The page on which a browser gives its token.

use super::document::document;
use maud::html;

/// The form. `next` is where it leads; `problem` says why the last token was refused.
pub fn login(next: &str, problem: Option<&str>) -> String {
    let main = html! {
        header { p class="kind" { "vrdp" } h1 { "Log in" } }
        @if let Some(problem) = problem { p role="alert" { strong { (problem) } } }
        form method="post" action="/login" {
            p {
                label for="token" { "Token of your tenant " }
                input id="token" name="token" type="password" required autocomplete="current-password" autofocus;
            }
            input type="hidden" name="next" value=(next);
            p { button { "Log in" } }
        }
    };
    document("Log in – vrdp", "; form-action 'self'; base-uri 'none'", "", main, "")
}

/// Says whose data the browser sees, and lets it end that.
pub fn logged_in(tenant: &str) -> String {
    let main = html! {
        header { p class="kind" { "vrdp" } h1 { "Logged in" } }
        p { "This browser sees the data of tenant " strong { (tenant) } ". " a href="/" { "Open the overview" } "." }
        form method="post" action="/logout" { button { "Log out" } }
    };
    document("Logged in – vrdp", "; form-action 'self'; base-uri 'none'", "", main, "")
}
