//! The HTML document around a page: it needs no network and has a light and a dark style.

use super::chart::PICTURE_STYLE;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const PAGE_STYLE: &str = include_str!("page.css");

/// The document. Its content security policy forbids all requests except those of the directives in `fetches`.
pub fn document(title: &str, fetches: &str, style: &str, main: Markup, script: &str) -> String {
    let policy =
        format!("default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'{fetches}");
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta http-equiv="Content-Security-Policy" content=(policy);
                title { (title) }
                style id="picture-style" { (PreEscaped(PICTURE_STYLE)) }
                style { (PreEscaped(PAGE_STYLE)) (PreEscaped(style)) }
            }
            body {
                main { (main) }
                script { (PreEscaped(script)) }
            }
        }
    };
    page.into_string()
}
