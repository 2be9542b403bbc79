//! A language model as the parser of questions that our reader does not understand: any endpoint with OpenAI's chat interface.
//!
//! It is asked for a program under the JSON schema of programs and sees the question, the questions before it and the names of the
//! video's objects. Its program is checked like every other; nothing else of its reply is used.

use crate::engine::error::EngineError;
use crate::engine::pool::JobContext;
use crate::reason::{
    Conversation, LexiconWord, WordUse, examples, json_schema, list_operations, ops, question_program,
};
use crate::scene::Scene;
use serde::Deserialize;
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;
use tokio::sync::Semaphore;

/// Calls of the endpoint at a time.
const CALLS_AT_ONCE: usize = 8;
/// Most bytes of a reply: a program of the longest allowed length has a tenth of it.
const REPLY_BYTES: usize = 256 << 10;

/// Where the language model is.
#[derive(Debug, Clone)]
pub struct ChatSettings {
    /// Of the interface, such as `http://127.0.0.1:8000/v1`.
    pub url: String,
    pub model: String,
    /// Sent as a bearer token.
    pub key: Option<String>,
    /// Longest wait for one program.
    pub timeout: Duration,
}

/// The parser behind the endpoint.
pub struct ChatParser {
    client: reqwest::Client,
    settings: ChatSettings,
    calls: Semaphore,
    /// How programs are written: the same for every question.
    manual: String,
}

#[derive(Deserialize)]
struct ChatReply {
    choices: Vec<ChatChoice>,
}

#[derive(Deserialize)]
struct ChatChoice {
    message: ChatMessage,
}

#[derive(Deserialize)]
struct ChatMessage {
    content: Option<String>,
}

#[derive(Deserialize)]
struct WrittenProgram {
    program: Vec<String>,
}

impl ChatParser {
    pub fn new(settings: ChatSettings) -> Result<ChatParser, EngineError> {
        let client = reqwest::Client::builder()
            .timeout(settings.timeout)
            // The key goes to the endpoint that was named, and to no other.
            .redirect(reqwest::redirect::Policy::none())
            .build()
            .map_err(|e| EngineError::Internal { id: "parser".into(), message: e.to_string() })?;
        Ok(ChatParser { client, settings, calls: Semaphore::new(CALLS_AT_ONCE), manual: manual() })
    }

    /// Name of the language model.
    pub fn model(&self) -> &str {
        &self.settings.model
    }

    /// What the words of a question may name.
    pub fn about(
        &self,
        scene: Option<&Scene>,
        lexicon: &[LexiconWord],
        conversation: &Conversation,
    ) -> String {
        let mut about = String::new();
        if let Some(scene) = scene {
            let names: Vec<String> = (0..scene.objects.len())
                .zip(&scene.objects)
                .map(|(k, object)| format!("{} (object {})", ops::name(scene, k), object.id))
                .collect();
            let _ = writeln!(about, "Objects of the video: {}.", names.join(", "));
        }
        let of = |used: &dyn Fn(WordUse) -> bool| -> Vec<&str> {
            lexicon.iter().filter(|w| used(w.of)).map(|w| w.word.as_str()).collect()
        };
        for (operation, words) in [
            ("filter_concept", of(&|u| matches!(u, WordUse::Objects | WordUse::Encounters))),
            ("apply", of(&|u| u == WordUse::Change)),
        ] {
            if !words.is_empty() {
                let _ = writeln!(about, "Further words, for {operation}: {}.", words.join(", "));
            }
        }
        for own in &conversation.words {
            let _ = writeln!(about, "\"{}\" means \"{}\".", own.word, own.means);
        }
        for previous in &conversation.previous {
            let _ = writeln!(about, "Asked before: {previous}");
        }
        about
    }

    /// The program of a text; that of a choice goes on from the question's.
    pub async fn program(
        &self,
        about: &str,
        text: &str,
        of_question: Option<&[String]>,
        context: &JobContext,
    ) -> Result<Vec<String>, EngineError> {
        let asked = match of_question {
            None => format!("{about}Write the program of this question: {text}"),
            Some(program) => format!(
                "{about}The program of a question is {}. Write the program of this choice, which goes on from it and ends in \
                 yes or no: {text}",
                program.join(" ")
            ),
        };
        let request = json!({
            "model": self.settings.model,
            "temperature": 0,
            "messages": [
                { "role": "system", "content": self.manual },
                { "role": "user", "content": asked },
            ],
            "response_format": {
                "type": "json_schema",
                "json_schema": { "name": "program", "strict": true, "schema": json_schema() },
            },
        });
        tokio::select! {
            biased;
            () = context.token.cancelled() => Err(EngineError::Cancelled),
            () = tokio::time::sleep_until(context.deadline.into()) => Err(EngineError::DeadlineExceeded),
            written = self.call(request) => written.map_err(|problem| self.refused(problem)),
        }
    }

    /// The refusal of a question that neither our reader nor the language model could turn into a program.
    pub fn refused(&self, problem: String) -> EngineError {
        tracing::warn!(model = self.settings.model, problem, "the language model wrote no usable program");
        EngineError::NotParsed { model: self.settings.model.clone(), problem }
    }

    async fn call(&self, request: Value) -> Result<Vec<String>, String> {
        let _call = self.calls.acquire().await.map_err(|e| e.to_string())?;
        let url = format!("{}/chat/completions", self.settings.url.trim_end_matches('/'));
        let mut call = self.client.post(url).json(&request);
        if let Some(key) = &self.settings.key {
            call = call.bearer_auth(key);
        }
        // The URL may hold what callers need not know.
        let failed = |e: reqwest::Error| e.without_url().to_string();
        let mut reply = call.send().await.map_err(failed)?;
        if !reply.status().is_success() {
            return Err(format!("it answered with status {}", reply.status().as_u16()));
        }
        let mut body = vec![];
        while let Some(chunk) = reply.chunk().await.map_err(failed)? {
            body.extend_from_slice(&chunk);
            if body.len() > REPLY_BYTES {
                return Err(format!("its reply has more than {REPLY_BYTES} bytes"));
            }
        }
        let reply: ChatReply =
            serde_json::from_slice(&body).map_err(|e| format!("its reply is no chat completion: {e}"))?;
        let content = reply.choices.into_iter().next().and_then(|c| c.message.content);
        written_program(&content.ok_or("its reply is empty")?)
    }
}

/// The program in a reply. Models that know no schema write text around the JSON.
fn written_program(content: &str) -> Result<Vec<String>, String> {
    let json = content.find('{').zip(content.rfind('}')).and_then(|(from, to)| content.get(from..=to));
    let written: WrittenProgram = serde_json::from_str(json.unwrap_or(content))
        .map_err(|e| format!("its reply holds no {{\"program\": [...]}}: {e}"))?;
    // A program in one string, with spaces between its tokens, is the same program.
    Ok(written.program.iter().flat_map(|t| t.split_whitespace()).map(String::from).collect())
}

/// How programs are written: the operations, and questions with their programs.
fn manual() -> String {
    let mut text = String::from(
        "You turn questions about a video of moving objects into programs. A program is a list of tokens in postfix order on a \
         stack: operands come before their operation. An operation's operands are listed from the bottom of the stack. Reply \
         with JSON {\"program\": [token, ...]} and nothing else.\nOperations:\n",
    );
    for operation in list_operations() {
        let _ = writeln!(text, "{} {}: {}", operation.name, operation.signature, operation.line);
    }
    text += "Questions and their programs:\n";
    for example in examples() {
        if let Ok(program) = question_program(&example) {
            let _ = writeln!(text, "{example} => {}", program.join(" "));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_found_in_what_a_model_writes() {
        let program = |text: &str| written_program(text);
        let expected: Vec<String> = ["objects", "count"].map(String::from).into();
        assert_eq!(program(r#"{"program": ["objects", "count"]}"#), Ok(expected.clone()));
        assert_eq!(program("Here:\n```json\n{\"program\": [\"objects count\"]}\n```"), Ok(expected));
        assert!(program("I do not know.").unwrap_err().contains("no {\"program\""));
        assert!(program(r#"{"program": "objects"}"#).is_err());
    }

    #[test]
    fn the_manual_names_every_operation_and_shows_programs() {
        let text = manual();
        assert!(list_operations().iter().all(|o| text.contains(&format!("\n{} ", o.name))));
        assert!(text.contains(" => objects"));
    }
}
