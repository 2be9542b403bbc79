//! `operations`: long work on a service, listed, shown, waited for and cancelled.

use crate::api::v1::operation::Result as OperationResult;
use crate::api::v1::{
    CancelOperationRequest, GetOperationRequest, ListOperationsRequest, Operation, OperationState, Progress,
    WaitOperationRequest,
};
use crate::cli::connection::stream::{StreamEvent, final_result};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::cli::output::progress::TaskProgress;
use serde_json::{Value, json};

/// Most rows of a list.
const MOST: i32 = 1000;

#[derive(clap::Args)]
pub struct OperationsArgs {
    #[command(subcommand)]
    action: Option<OperationsAction>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE", global = true)]
    json: Option<String>,
}

#[derive(clap::Subcommand)]
enum OperationsAction {
    /// Lists the newest operations (the default).
    List,
    /// Shows how one stands.
    Show { operation: String },
    /// Waits until one has ended; exits with status 1 unless it succeeded.
    Wait { operation: String },
    /// Stops one.
    Cancel { operation: String },
}

pub async fn run(target: &Target, args: OperationsArgs) -> Result<(), Failure> {
    let connection = Connection::open(target).await?;
    let mut client = connection.operations();
    let named = |id: &str| format!("operations/{}", id.trim_start_matches("operations/"));
    let mut waited = false;
    let operations = match args.action.unwrap_or(OperationsAction::List) {
        OperationsAction::List => {
            let request = ListOperationsRequest { page_size: MOST, ..Default::default() };
            client.list_operations(request).await?.into_inner().operations
        }
        OperationsAction::Show { operation } => {
            let request = GetOperationRequest { name: named(&operation) };
            vec![client.get_operation(request).await?.into_inner()]
        }
        OperationsAction::Wait { operation } => {
            waited = true;
            vec![ended(&connection, named(&operation)).await?]
        }
        OperationsAction::Cancel { operation } => {
            let request = CancelOperationRequest { name: named(&operation) };
            vec![client.cancel_operation(request).await?.into_inner()]
        }
    };
    let value = || json!({ "operations": operations.iter().map(to_json).collect::<Vec<_>>() });
    let errors: String =
        operations.iter().filter_map(error).map(|message| format!("  {message}\n")).collect();
    let errors = if waited { "" } else { &errors };
    output::result(args.json.as_deref(), &(text(&operations) + errors), value)?;
    connection.close().await?;
    match operations.first().and_then(error) {
        Some(message) if waited => Err(Failure::other(message)),
        _ => Ok(()),
    }
}

/// The operation when it has ended.
async fn ended(connection: &Connection, name: String) -> Result<Operation, Failure> {
    let progress = TaskProgress::new(1);
    let open =
        async || connection.operations().wait_operation(WaitOperationRequest { name: name.clone() }).await;
    let event = |now: Operation| match now.done {
        true => Some(StreamEvent::Result(now)),
        false => Some(StreamEvent::Progress(now.progress.map_or(0.0, |at| at.fraction))),
    };
    final_result(open, event, |fraction| progress.show("operation", 0, fraction)).await
}

fn error(operation: &Operation) -> Option<String> {
    match &operation.result {
        Some(OperationResult::Error(error)) => Some(error.message.clone()),
        _ => None,
    }
}

/// The part of a name of an enumeration after its prefix, in small letters.
fn word(name: &str, prefix: &str) -> String {
    name.strip_prefix(prefix).unwrap_or(name).to_lowercase()
}

fn text(operations: &[Operation]) -> String {
    if operations.is_empty() {
        return "there are no operations\n".into();
    }
    let row = |o: &Operation| {
        let state = word(o.state().as_str_name(), "OPERATION_STATE_");
        let state = match (&o.progress, o.state()) {
            (Some(Progress { fraction, .. }), OperationState::Running) => {
                format!("{state}, {:.0} %", 100.0 * fraction)
            }
            _ => state,
        };
        let id = o.name.trim_start_matches("operations/").to_string();
        vec![id, word(o.kind().as_str_name(), "OPERATION_KIND_"), state, o.videos.len().to_string()]
    };
    let rows: Vec<Vec<String>> = operations.iter().map(row).collect();
    output::table(&["operation", "does", "state", "videos"], &rows)
}

fn to_json(o: &Operation) -> Value {
    let time =
        |t: &Option<prost_types::Timestamp>| t.as_ref().map(|t| t.seconds as f64 + 1e-9 * f64::from(t.nanos));
    json!({
        "operation": o.name,
        "kind": word(o.kind().as_str_name(), "OPERATION_KIND_"),
        "state": word(o.state().as_str_name(), "OPERATION_STATE_"),
        "done": o.done,
        "videos": o.videos,
        "request_id": o.request_id,
        "created_s": time(&o.create_time),
        "ended_s": time(&o.end_time),
        "expires_s": time(&o.expire_time),
        "progress": o.progress.as_ref().map(|at| at.fraction),
        "error": error(o),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1::{Error, OperationKind};

    #[test]
    fn a_row_says_what_an_operation_does_and_how_it_stands() {
        let progress = Some(Progress { fraction: 0.42, ..Default::default() });
        let mut running = Operation { name: "operations/e7".into(), progress, ..Default::default() };
        running.set_state(OperationState::Running);
        running.set_kind(OperationKind::DiscoverEffects);
        let failure = Error { code: 9, message: "too few samples".into(), violations: vec![] };
        let mut failed = Operation { name: "operations/e8".into(), done: true, ..running.clone() };
        failed.set_state(OperationState::Failed);
        failed.result = Some(OperationResult::Error(failure));
        let shown = text(&[running, failed.clone()]);
        let words: Vec<&str> = shown.split_whitespace().collect();
        let row =
            ["e7", "discover_effects", "running,", "42", "%", "0", "e8", "discover_effects", "failed", "0"];
        assert!(words.ends_with(&row), "{shown}");
        let json = to_json(&failed);
        assert_eq!([&json["state"], &json["error"]], ["failed", "too few samples"]);
        assert_eq!(text(&[]), "there are no operations\n");
    }
}
