//! The frame of a page: one HTML document that needs no network, in the light and in the dark.

use super::chart::STYLE;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const PAGE_STYLE: &str = include_str!("page.css");

/// The document; `fetches` are the directives of its policy for what it may fetch, whatever a name in it holds.
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
                style { (PreEscaped(STYLE)) (PreEscaped(PAGE_STYLE)) (PreEscaped(style)) }
            }
            body {
                main { (main) }
                script { (PreEscaped(script)) }
            }
        }
    };
    page.into_string()
}
