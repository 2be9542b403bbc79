//! The documentation, tested: its commands run, its quotations stand in the source, its links lead somewhere, its
//! sentences are short. (`tests/tidy.rs` keeps words out that a newcomer would not know.)
//!
//! Fences and what is done with them:
//!
//! | fence | test |
//! |---|---|
//! | `sh` | runs in a scratch folder with a copy of `tests/data`, `vrdp` being on the path |
//! | `sh background` | is started, and stopped when its page ends |
//! | `text output` | its lines are in the output of the block before |
//! | `console` | needs a network, Docker or a cluster: the files and RPCs that it names must exist |
//! | `rust`, `proto` with `// path/of/file` in front | a quotation: its lines stand in that file; `// ...` skips some |

use std::collections::BTreeSet;
use std::fs::File;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// README is one page, and the changelog tells only what a user notices.
const MAX_README_LINES: usize = 120;
const MAX_CHANGELOG_LINES: usize = 40;
const MAX_SENTENCE_WORDS: usize = 30;
/// A command of the documentation that takes longer hangs.
const MAX_COMMAND: Duration = Duration::from_secs(600);
/// How long a service may take to listen.
const MAX_START: Duration = Duration::from_secs(60);
/// Ports of a service that is started without flags; the tests use free ones in their place.
const PORTS: [&str; 2] = ["50051", "8080"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A Markdown file of the repository.
struct Page {
    name: String,
    text: String,
}

/// A fenced block: its fence, the line of its first line, and its lines.
struct Block {
    fence: String,
    line: usize,
    lines: Vec<String>,
}

fn page(name: &str) -> Page {
    let text = std::fs::read_to_string(root().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    Page { name: name.to_string(), text }
}

/// README, then the pages of `docs/` by name.
fn guides() -> Vec<Page> {
    let folder = std::fs::read_dir(root().join("docs")).unwrap();
    let names = folder.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".md")).collect();
    names.sort();
    let names = names.iter().map(|name| format!("docs/{name}"));
    std::iter::once("README.md".to_string()).chain(names).map(|name| page(&name)).collect()
}

fn all_pages() -> Vec<Page> {
    let others = ["ARCHITECTURE.md", "CHANGELOG.md", "tests/README.md"];
    guides().into_iter().chain(others.map(page)).collect()
}

impl Page {
    fn blocks(&self) -> Vec<Block> {
        let mut blocks: Vec<Block> = vec![];
        let mut inside = false;
        for (k, line) in self.text.lines().enumerate() {
            match (line.strip_prefix("```"), inside) {
                (Some(fence), false) => {
                    blocks.push(Block { fence: fence.trim().to_string(), line: k + 2, lines: vec![] });
                    inside = true;
                }
                (Some(_), true) => inside = false,
                (None, true) => blocks.last_mut().unwrap().lines.push(line.to_string()),
                (None, false) => {}
            }
        }
        assert!(!inside, "{}: a fence is not closed", self.name);
        blocks
    }

    /// The lines outside of fences, with their numbers; those inside are empty.
    fn prose(&self) -> Vec<&str> {
        let mut inside = false;
        let outside = |line| match str::starts_with(line, "```") {
            true => {
                inside = !inside;
                ""
            }
            false if inside => "",
            false => line,
        };
        self.text.lines().map(outside).collect()
    }
}

/// Every violation at once.
fn check(rule: &str, violations: Vec<String>) {
    assert!(violations.is_empty(), "{rule}:\n{}", violations.join("\n"));
}

// Commands.

/// A service that a page started; it is stopped as an operator stops it.
struct Service(Child);

impl Drop for Service {
    fn drop(&mut self) {
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

/// A folder in which commands run as in a checkout, and the ports that stand for those of the pages.
struct Scratch {
    folder: PathBuf,
    ports: [String; 2],
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Scratch {
    fn new() -> Scratch {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("docs-{}", std::process::id()));
        copy(&root().join("tests/data"), &folder.join("tests/data"));
        // Both are held until both are known: they differ.
        let free = [(); 2].map(|()| TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
        let ports = free.map(|listener| listener.local_addr().unwrap().port().to_string());
        Scratch { folder, ports }
    }

    fn command(&self, script: &str, output: &Path) -> Command {
        let mut script = script.to_string();
        for (page, own) in PORTS.iter().zip(&self.ports) {
            script = script.replace(page, own);
        }
        let program = Path::new(env!("CARGO_BIN_EXE_vrdp")).parent().unwrap();
        let mut path = program.as_os_str().to_os_string();
        path.push(":");
        path.push(std::env::var_os("PATH").unwrap_or_default());
        let log = File::create(output).unwrap();
        let mut command = Command::new("sh");
        command.args(["-euxc", &script]).current_dir(&self.folder).env("PATH", path);
        for (key, port) in ["VRDP_LISTEN", "VRDP_HTTP"].iter().zip(&self.ports) {
            command.env(key, format!("127.0.0.1:{port}"));
        }
        command.stdin(Stdio::null()).stdout(log.try_clone().unwrap()).stderr(log);
        command
    }

    /// Runs a block to its end and returns what it wrote.
    fn run(&self, block: &Block) -> Result<String, String> {
        let output = self.folder.join("output.log");
        let mut child = self.command(&block.lines.join("\n"), &output).spawn().unwrap();
        let start = Instant::now();
        let problem = loop {
            match child.try_wait().unwrap() {
                Some(status) if status.success() => return Ok(std::fs::read_to_string(output).unwrap()),
                Some(status) => break status.to_string(),
                None if start.elapsed() > MAX_COMMAND => {
                    let _ = child.kill();
                    break format!("no end after {MAX_COMMAND:?}");
                }
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        };
        Err(format!("{problem}\n{}", std::fs::read_to_string(output).unwrap_or_default()))
    }

    /// Starts a service, and waits until it listens.
    fn start(&self, block: &Block) -> Result<Service, String> {
        let output = self.folder.join("service.log");
        // The shell becomes the service, so that the signal reaches it.
        let script = format!("exec {}", block.lines.join("\n"));
        let service = Service(self.command(&script, &output).spawn().unwrap());
        let port: u16 = self.ports[0].parse().unwrap();
        let start = Instant::now();
        while TcpStream::connect((Ipv4Addr::LOCALHOST, port)).is_err() {
            if start.elapsed() > MAX_START {
                return Err(format!(
                    "does not listen\n{}",
                    std::fs::read_to_string(output).unwrap_or_default()
                ));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(service)
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &to),
            false => std::fs::copy(entry.path(), to).map(|_| ()).unwrap(),
        }
    }
}

/// All pages share one folder, README first: so a reader goes through them, and what one page found is kept for the next.
#[test]
fn every_command_runs() {
    let scratch = Scratch::new();
    for page in guides() {
        let mut services = vec![];
        let mut output = None;
        for block in page.blocks() {
            if let Some(program) = missing_program(&block) {
                // The rest of the page builds on it.
                println!("{}:{}: {program} is not installed here", page.name, block.line);
                break;
            }
            let start = Instant::now();
            let place = format!("{}:{}", page.name, block.line);
            let done = match block.fence.as_str() {
                "sh" => scratch.run(&block).map(|text| output = Some(text)),
                "sh background" => scratch.start(&block).map(|service| services.push(service)),
                "text output" => holds(output.as_deref().unwrap_or_default(), &block),
                _ => continue,
            };
            println!("{place}: {:.1} s", start.elapsed().as_secs_f64());
            done.unwrap_or_else(|problem| panic!("{place}: {problem}"));
        }
        assert!(output.is_some(), "{}: has no command that is run", page.name);
    }
}

/// A program of the system that a block needs and a developer's machine may lack; CI has them.
fn missing_program(block: &Block) -> Option<&'static str> {
    let used = |name: &&str| {
        block.fence == "sh" && block.lines.iter().any(|line| line.split_whitespace().next() == Some(*name))
    };
    let installed = |name: &str| {
        let path = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
    };
    let missing = ["curl", "openssl"].into_iter().filter(used).find(|name| !installed(name));
    missing.filter(|_| std::env::var_os("CI").is_none())
}

/// Whether every line of the block is in the output; the number of blanks does not count.
fn holds(output: &str, block: &Block) -> Result<(), String> {
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let written: BTreeSet<String> = output.lines().map(words).collect();
    let missing = block.lines.iter().find(|line| !written.contains(&words(line)));
    missing.map_or(Ok(()), |line| Err(format!("this line is not in the output: {line}\n{output}")))
}

#[test]
fn what_cannot_be_run_names_files_that_exist() {
    let mut violations = vec![];
    for page in all_pages() {
        for block in page.blocks().iter().filter(|block| block.fence == "console") {
            for (k, line) in block.lines.iter().enumerate() {
                for word in line.split_whitespace().filter(|word| word.contains('/')) {
                    let word = word.trim_matches('"').split('[').next().unwrap();
                    let known = word.contains("://") || is_rpc(word) || root().join(word).exists();
                    if !known {
                        violations.push(format!("{}:{}: {word}", page.name, block.line + k));
                    }
                }
            }
        }
    }
    check("commands name files that do not exist", violations);
}

/// Whether a word is a method of the interface, such as `vrdp.v1.Models/ListEffects`.
fn is_rpc(word: &str) -> bool {
    let Some((service, method)) = word.strip_prefix("vrdp.v1.").and_then(|rest| rest.split_once('/')) else {
        return false;
    };
    let files = std::fs::read_dir(root().join("proto/vrdp/v1")).unwrap();
    let text = |path: PathBuf| std::fs::read_to_string(path).unwrap();
    files.map(|file| text(file.unwrap().path())).any(|text| {
        text.contains(&format!("service {service} {{")) && text.contains(&format!("rpc {method}("))
    })
}

#[test]
fn every_flag_exists() {
    let help = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_vrdp")).args(arguments).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let commands: Vec<String> = help(&["--help"])
        .lines()
        .skip_while(|line| !line.starts_with("Commands:"))
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| Some(line.split_whitespace().next()?.to_string()))
        .filter(|command| command != "help")
        .collect();
    assert!(commands.contains(&"fit".to_string()), "{commands:?}");
    let mut known = help(&["--help"]);
    commands.iter().for_each(|command| known += &help(&[command, "--help"]));
    ["info", "verify", "export"].iter().for_each(|part| known += &help(&["trace", part, "--help"]));
    let known: BTreeSet<String> = known.split_whitespace().flat_map(flags).collect();
    let mut violations = vec![];
    for page in guides() {
        // A command in code is that of `vrdp` where it is one of its lines, or a flag by itself.
        let spans = page.prose().join("\n");
        let spans = spans.split('`').skip(1).step_by(2);
        let spans =
            spans.filter(|span| span.starts_with("--") || span.starts_with("vrdp ")).map(str::to_string);
        let blocks = page.blocks();
        let lines = blocks.iter().filter(|b| b.fence.starts_with("sh")).flat_map(|b| b.lines.clone());
        for line in spans.chain(lines.filter(|line| line.contains("vrdp "))) {
            for flag in line.split_whitespace().flat_map(flags).filter(|flag| !known.contains(flag)) {
                violations.push(format!("{}: {flag} in {line}", page.name));
            }
        }
    }
    check("flags that no command has", violations);
}

/// `--flag` at the beginning of a word.
fn flags(word: &str) -> Option<String> {
    let word = word.trim_start_matches(['[', '`', '(']);
    let name = word.strip_prefix("--")?;
    let end = name.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(name.len());
    (end > 0).then(|| format!("--{}", &name[..end]))
}

#[test]
fn the_catalogue_has_every_effect() {
    let table = std::fs::read_to_string(root().join("src/effects/mod.rs")).unwrap();
    let files = table
        .split("EffectEntry::of::<")
        .skip(1)
        .filter_map(|rest| rest.split('>').next()?.rsplit("::").nth(1));
    let page = page("docs/models-and-effects.md");
    let missing = files.filter(|name| !page.text.contains(&format!("`{name}`")));
    check("effects that docs/models-and-effects.md lacks", missing.map(str::to_string).collect());
}

// Quotations and links.

#[test]
fn quotations_stand_in_the_source() {
    let mut violations = vec![];
    let mut count = 0;
    for page in all_pages() {
        for block in page.blocks().iter().filter(|block| ["rust", "proto"].contains(&block.fence.as_str())) {
            let place = format!("{}:{}", page.name, block.line);
            let path = block.lines.first().and_then(|line| line.strip_prefix("// "));
            let Some(path) = path.filter(|path| root().join(path).is_file()) else {
                violations.push(format!("{place}: begin with `// path/of/file` of what is quoted"));
                continue;
            };
            count += 1;
            let source = std::fs::read_to_string(root().join(path)).unwrap();
            let source: Vec<&str> = source.lines().map(str::trim).collect();
            let quoted: Vec<&str> = block.lines.iter().skip(1).map(|line| line.trim()).collect();
            for part in quoted.split(|line| *line == "// ...").filter(|part| !part.is_empty()) {
                if !source.windows(part.len()).any(|lines| lines == part) {
                    violations.push(format!("{place}: does not stand in {path}:\n{}", part.join("\n")));
                }
            }
        }
    }
    check("quotations", violations);
    assert!(count > 0, "no quotation was found");
}

/// A name of the source in ARCHITECTURE.md: `Jet`, `Engine::of`, `api/status.rs`.
#[test]
fn names_are_those_of_the_source() {
    let sources: Vec<(PathBuf, String)> = ["src", "proto", "tests/tidy.rs", "tests/service"]
        .iter()
        .flat_map(|name| files_below(&root().join(name)))
        .filter_map(|path| Some((path.clone(), std::fs::read_to_string(path).ok()?)))
        .collect();
    let words =
        |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').map(str::to_string).collect();
    let known: BTreeSet<String> =
        sources.iter().flat_map(|(_, text)| -> Vec<String> { words(text) }).collect();
    let mut violations = vec![];
    for name in ["ARCHITECTURE.md", "tests/README.md"] {
        for (k, line) in page(name).prose().iter().enumerate() {
            // A span with blanks is a command or a formula.
            for span in line.split('`').skip(1).step_by(2).filter(|span| !span.contains(' ')) {
                let exists = match (span.contains('/') || span.ends_with(".rs"), span.strip_suffix("...")) {
                    (true, _) => {
                        let has = |path: &Path| path.ancestors().any(|folder| folder.ends_with(span));
                        span.contains('*')
                            || root().join(span).exists()
                            || sources.iter().any(|(path, _)| has(path))
                    }
                    (_, Some(start)) => {
                        let start = start.rsplit("::").next().unwrap();
                        known.iter().any(|word| word.starts_with(start))
                    }
                    _ if name != "ARCHITECTURE.md" && !span.contains("::") => true,
                    _ => words(span).iter().all(|word: &String| known.contains(word)),
                };
                if !exists {
                    violations.push(format!("{name}:{}: {span}", k + 1));
                }
            }
        }
    }
    check("names that are not in the source", violations);
}

fn files_below(path: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(path) {
        Ok(entries) => entries.flat_map(|entry| files_below(&entry.unwrap().path())).collect(),
        Err(_) => vec![path.to_path_buf()],
    }
}

#[test]
fn every_relative_link_leads_to_a_file() {
    let mut violations = vec![];
    for page in all_pages() {
        let folder = root().join(&page.name).parent().unwrap().to_path_buf();
        for (k, line) in page.prose().iter().enumerate() {
            for target in line.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
                if target.contains("://") {
                    continue;
                }
                let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
                let file = if file.is_empty() { root().join(&page.name) } else { folder.join(file) };
                let found = match anchor {
                    "" => file.exists(),
                    _ => std::fs::read_to_string(&file)
                        .is_ok_and(|text| text.lines().any(|l| is_anchor(l, anchor))),
                };
                if !found {
                    violations.push(format!("{}:{}: {target}", page.name, k + 1));
                }
            }
        }
    }
    check("links that lead nowhere", violations);
}

/// Whether a line is the heading of that anchor, as GitHub names it.
fn is_anchor(line: &str, anchor: &str) -> bool {
    line.strip_prefix('#').is_some_and(|rest| {
        let title = rest.trim_start_matches('#').trim().to_lowercase();
        let name = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        name.map(|c| if c == ' ' { '-' } else { c }).collect::<String>() == anchor
    })
}

// Language.

#[test]
fn pages_are_short() {
    let long = |name: &str, most: usize| {
        let lines = page(name).text.lines().count();
        (lines > most).then(|| format!("{name}: {lines} lines; at most {most}"))
    };
    let long = [long("README.md", MAX_README_LINES), long("CHANGELOG.md", MAX_CHANGELOG_LINES)];
    check("pages are too long", long.into_iter().flatten().collect());
}

#[test]
fn sentences_are_short() {
    let mut violations = vec![];
    for page in all_pages() {
        for (line, sentence) in sentences(&page.prose()) {
            let words = sentence.split_whitespace().filter(|w| w.contains(char::is_alphanumeric)).count();
            if words > MAX_SENTENCE_WORDS {
                violations.push(format!("{}:{line}: {words} words: {sentence}", page.name));
            }
        }
    }
    check("sentences of more than 30 words", violations);
}

/// Sentences with the line of their paragraph. Code counts as one word; tables, headings and link targets do not count.
fn sentences(prose: &[&str]) -> Vec<(usize, String)> {
    let mut paragraphs: Vec<(usize, String)> = vec![];
    let mut ended = true;
    for (k, line) in prose.iter().enumerate() {
        let text = line.trim();
        let item = text.strip_prefix("- ").or(text.strip_prefix("* "));
        let item =
            item.or_else(|| text.split_once(". ").filter(|(n, _)| n.parse::<u32>().is_ok()).map(|(_, t)| t));
        if text.is_empty() || text.starts_with('|') || text.starts_with('#') {
            ended = true;
            continue;
        }
        match paragraphs.last_mut().filter(|_| !ended && item.is_none()) {
            Some((_, paragraph)) => *paragraph += &format!(" {text}"),
            None => paragraphs.push((k + 1, item.unwrap_or(text).to_string())),
        }
        ended = false;
    }
    let split = |(line, text): (usize, String)| {
        let plain: String =
            text.split('`').enumerate().map(|(k, part)| if k % 2 == 1 { "code" } else { part }).collect();
        let mut linked = String::new();
        for (k, part) in plain.split("](").enumerate() {
            linked += if k == 0 { part } else { part.split_once(')').map_or("", |(_, rest)| rest) };
        }
        let ends = linked.replace("! ", ". ").replace("? ", ". ");
        ends.split(". ").map(|sentence| (line, sentence.to_string())).collect::<Vec<_>>()
    };
    paragraphs.into_iter().flat_map(split).collect()
}

#[test]
fn sentences_are_found() {
    let found = sentences(&[
        "# Title",
        "One two. Three `a b c`",
        "four!",
        "- An item",
        "",
        "| a. b |",
        "See [x y](z.md).",
    ]);
    let texts: Vec<&str> = found.iter().map(|(_, text)| text.as_str()).collect();
    assert_eq!(texts, ["One two", "Three code four!", "An item", "See [x y."]);
}
