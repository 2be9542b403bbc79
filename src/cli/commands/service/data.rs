//! `data`: copies a data folder while it is used, says what is damaged in it, and makes a folder of a copy.

use crate::cli::connection::Target;
use crate::cli::connection::{backup_from_service, check_by_service};
use crate::cli::error::Failure;
use crate::cli::output::print;
use crate::config::{Config, Flags};
use crate::store::{BackupReport, CheckReport, Store, StoreError, now_ms, restore};
use clap::Subcommand;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Most damaged records that an error names.
const MOST_FAULTS: usize = 20;

#[derive(clap::Args)]
pub struct DataArgs {
    #[command(subcommand)]
    command: DataCommand,
}

#[derive(Subcommand)]
enum DataCommand {
    /// Copies all tenants' data into one file; a service that uses the folder goes on.
    Backup {
        /// The file, which must not exist, or a folder for a file with the time in its name.
        path: PathBuf,
    },
    /// Reads every row and trace file, and names what is damaged (exit status 1); a service that uses the folder goes on.
    Check,
    /// Makes the data folder, which must be empty or absent, of a backup.
    Restore {
        /// A file that `backup` wrote.
        file: PathBuf,
    },
}

pub async fn run(target: &Target, args: DataArgs) -> Result<(), Failure> {
    let flags = Flags { data_dir: target.data_dir.clone(), ..Flags::default() };
    let folder = Config::for_command(flags).map_err(|e| Failure::input(e.to_string()))?.data_dir;
    let work = move || match args.command {
        DataCommand::Backup { path } => backup(&folder, &path),
        DataCommand::Check => check(&folder),
        DataCommand::Restore { file } => restored(&file, &folder),
    };
    tokio::task::spawn_blocking(work).await.map_err(Failure::other)?
}

/// The folder, if no other process holds it.
fn open(folder: &Path) -> Result<Option<Store>, Failure> {
    match Store::open_unchanged(folder) {
        Ok(store) => Ok(Some(store)),
        Err(StoreError::Locked { .. }) => Ok(None),
        Err(error) => Err(Failure::input(error.to_string())),
    }
}

fn backup(folder: &Path, path: &Path) -> Result<(), Failure> {
    let path = match path.is_dir() {
        true => path.join(format!("vrdp-{}.backup", now_ms())),
        false => path.to_path_buf(),
    };
    if path.exists() {
        let message = format!("{} exists already; choose a new name, or a folder", path.display());
        return Err(Failure::input(message));
    }
    let unwritten = |e: std::io::Error| Failure::input(format!("{}: {e}", path.display()));
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // A backup that ends early leaves no file.
    let file = tempfile::NamedTempFile::new_in(parent).map_err(unwritten)?;
    let mut to = BufWriter::new(file);
    let report = match open(folder)? {
        Some(store) => store.backup(&mut to).map_err(Failure::other)?,
        None => backup_from_service(folder, &mut to)?,
    };
    to.flush().map_err(unwritten)?;
    let file = to.into_inner().map_err(|e| unwritten(e.into_error()))?;
    file.as_file().sync_all().map_err(unwritten)?;
    file.persist_noclobber(&path).map_err(|e| unwritten(e.error))?;
    let BackupReport { rows, trace_files, bytes, unreadable } = report;
    print(&format!("{}: {rows} rows and {trace_files} traces, {bytes} bytes\n", path.display()))?;
    damage("the backup lacks", &unreadable)
}

fn check(folder: &Path) -> Result<(), Failure> {
    let report = match open(folder)? {
        Some(store) => store.check().map_err(Failure::other)?,
        None => check_by_service(folder)?,
    };
    let CheckReport { rows, trace_files, faults } = report;
    print(&format!("{rows} rows and {trace_files} traces were read\n"))?;
    let faults: Vec<String> = faults.iter().map(|f| format!("{}: {}", f.record, f.problem)).collect();
    damage("damaged are", &faults)
}

/// The failure that names what is damaged.
fn damage(what: &str, records: &[String]) -> Result<(), Failure> {
    if records.is_empty() {
        return Ok(());
    }
    let more = match records.len().saturating_sub(MOST_FAULTS) {
        0 => String::new(),
        more => format!("\nand {more} more"),
    };
    let named = records[..records.len().min(MOST_FAULTS)].join("\n");
    Err(Failure::Other(format!("{what} {} records:\n{named}{more}", records.len())))
}

fn restored(file: &Path, folder: &Path) -> Result<(), Failure> {
    let wrong = |e: std::io::Error| Failure::input(format!("{}: {e}", file.display()));
    let from = BufReader::new(File::open(file).map_err(wrong)?);
    let report = restore(from, folder).map_err(|e| Failure::input(e.to_string()))?;
    print(&format!("{}: {} rows and {} traces\n", folder.display(), report.rows, report.trace_files))
}
