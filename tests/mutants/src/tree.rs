//! The mutated copy of the project: the same files but for those in scope, built apart from the project.

use std::collections::{BTreeMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde::Deserialize;

use crate::find::{self, Site};
use crate::mutant::{Mutant, mutants};
use crate::scope::{PACKAGES, PATHS};
use crate::weave::{Span, weave};

const SWITCH: &str = "mutant-switch";
const SWITCH_MANIFEST: &str = "[package]\nname = \"mutant-switch\"\nedition = \"2024\"\n";

/// A test program of the mutated copy.
pub(crate) struct Program {
    pub(crate) path: PathBuf,
    /// Where cargo would start it.
    pub(crate) folder: PathBuf,
}

/// Where the mutants are in each mutated file.
type Spans = BTreeMap<String, Vec<Span>>;

/// The copy.
pub(crate) struct Tree {
    copy: PathBuf,
    /// What cargo builds, apart from the project's own.
    built: PathBuf,
    /// What each mutated file was when it was copied: somebody may work on it meanwhile.
    files: BTreeMap<String, (String, Vec<Site>)>,
    /// Changes that do not compile, by file and words, so that the next build does not try them again.
    senseless: HashSet<String>,
}

impl Tree {
    /// Copies the project at `project` into `folder`, where an older copy may stand.
    pub(crate) fn new(project: &Path, folder: &Path) -> Result<Self, String> {
        let copy = folder.join("copy");
        let listed =
            output(Command::new("git").args(["ls-files", "-co", "--exclude-standard"]).current_dir(project))?;
        let mut files = BTreeMap::new();
        let mut kept = HashSet::new();
        for name in listed.lines() {
            let from = project.join(name);
            // Deleted, but not yet for git.
            let Ok(bytes) = std::fs::read(&from) else { continue };
            kept.insert(copy.join(name));
            if in_scope(name) {
                let text = String::from_utf8(bytes).map_err(|_| format!("{name}: not UTF-8"))?;
                let sites = find::sites(&text).map_err(|error| format!("{name}: {error}"))?;
                files.insert(name.to_owned(), (text, sites));
            } else {
                let bytes = if name.ends_with("Cargo.toml") { with_switch(name, bytes) } else { bytes };
                write(&copy.join(name), &bytes)?;
                copy_mode(&from, &copy.join(name))?;
            }
        }
        let switch = copy.join(SWITCH);
        write(&switch.join("Cargo.toml"), SWITCH_MANIFEST.as_bytes())?;
        write(&switch.join("src/lib.rs"), include_bytes!("switch.rs"))?;
        kept.extend([switch.join("Cargo.toml"), switch.join("src/lib.rs")]);
        remove_others(&copy, &kept).map_err(|error| format!("{}: {error}", copy.display()))?;
        let senseless = std::fs::read_to_string(folder.join("senseless")).unwrap_or_default();
        let senseless = senseless.lines().map(str::to_owned).collect();
        Ok(Self { copy, built: folder.join("built"), files, senseless })
    }

    /// All that could be changed, whether it compiles or not.
    pub(crate) fn mutants(&self) -> Vec<Mutant> {
        self.files.iter().flat_map(|(name, (text, sites))| mutants(name, text, sites)).collect()
    }

    /// Leaves the mutants with these keys.
    pub(crate) fn keep(&mut self, keys: &HashSet<String>) {
        self.retain(|mutant| keys.contains(&mutant.key()));
    }

    fn retain(&mut self, good: impl Fn(&Mutant) -> bool) {
        for (name, (text, sites)) in &mut self.files {
            for site in sites.iter_mut() {
                let found = mutants(name, text, std::slice::from_ref(site));
                let mut good = found.iter().map(&good);
                site.changes.retain(|_| good.next().unwrap_or(false));
            }
            sites.retain(|site| !site.changes.is_empty());
        }
    }

    /// Builds the tests of the mutated packages, and gives all mutants, whose numbers begin with 1. Changes that do not
    /// compile are taken back.
    pub(crate) fn build(&mut self) -> Result<(Vec<Mutant>, Vec<Program>), String> {
        loop {
            let (all, spans) = self.write()?;
            // Errors of types hide those of borrowing: it takes a few times.
            let (errors, programs) = self.cargo()?;
            if errors.is_empty() {
                return Ok((all, programs));
            }
            let before = self.senseless.len();
            for error in &errors {
                for id in error.mutants(&spans) {
                    self.senseless.insert(all[id as usize - 1].key());
                }
            }
            println!("{} changes do not compile", self.senseless.len());
            if self.senseless.len() == before {
                let said: Vec<&str> = errors.iter().map(|error| &*error.rendered).collect();
                return Err(format!("the mutated copy does not compile:\n{}", said.join("\n")));
            }
            let mut lines: Vec<&str> = self.senseless.iter().map(String::as_str).collect();
            lines.sort_unstable();
            write(&self.built.with_file_name("senseless"), (lines.join("\n") + "\n").as_bytes())?;
        }
    }

    /// Writes the mutated files.
    fn write(&mut self) -> Result<(Vec<Mutant>, Spans), String> {
        let senseless = std::mem::take(&mut self.senseless);
        self.retain(|mutant| !senseless.contains(&mutant.key()));
        self.senseless = senseless;
        let mut all = Vec::new();
        let mut spans = Spans::new();
        for (name, (text, sites)) in &self.files {
            let (woven, where_) = weave(text, sites, all.len() as u32 + 1);
            all.extend(mutants(name, text, sites));
            write(&self.copy.join(name), woven.as_bytes())?;
            spans.insert(name.clone(), where_);
        }
        Ok((all, spans))
    }

    fn cargo(&self) -> Result<(Vec<CompileError>, Vec<Program>), String> {
        let mut cargo = Command::new("cargo");
        cargo.args(["test", "--no-run", "--lib", "--tests", "--message-format=json", "--quiet"]);
        for (package, _) in PACKAGES {
            cargo.args(["--package", package]);
        }
        cargo.current_dir(&self.copy).stderr(Stdio::inherit());
        cargo.env("CARGO_TARGET_DIR", &self.built).env_remove("RUSTFLAGS");
        // The switch asks whether the compiler computes, which only a nightly compiler lets others do.
        cargo.env("RUSTC_BOOTSTRAP", "mutant_switch").env("RUSTFLAGS", "--cap-lints=warn");
        cargo.env("CARGO_PROFILE_DEV_OPT_LEVEL", "1").env("CARGO_PROFILE_DEV_DEBUG", "0");
        let output = cargo.output().map_err(|error| format!("cargo: {error}"))?;
        let text = String::from_utf8_lossy(&output.stdout);
        let messages = text.lines().filter_map(|line| serde_json::from_str::<Message>(line).ok());
        let (mut errors, mut programs) = (Vec::new(), Vec::new());
        for message in messages {
            errors.extend(message.message.filter(|said| said.level == "error" && !said.spans.is_empty()));
            if let (Some(path), Some(manifest)) = (message.executable, message.manifest_path) {
                let folder = manifest.parent().unwrap_or(Path::new("/")).to_owned();
                programs.push(Program { path, folder });
            }
        }
        if !output.status.success() && errors.is_empty() {
            return Err(format!("cargo could not build the mutated copy:\n{text}"));
        }
        Ok((errors, programs))
    }
}

#[derive(Deserialize)]
struct Message {
    message: Option<CompileError>,
    executable: Option<PathBuf>,
    manifest_path: Option<PathBuf>,
}

#[derive(Deserialize)]
struct CompileError {
    level: String,
    rendered: String,
    spans: Vec<ErrorSpan>,
}

#[derive(Deserialize)]
struct ErrorSpan {
    file_name: String,
    byte_start: usize,
    is_primary: bool,
    label: Option<String>,
}

impl CompileError {
    /// The mutants that it is about: those of the smallest place around where it is.
    fn mutants(&self, spans: &Spans) -> Vec<u32> {
        let inside = |error: &&ErrorSpan| {
            let file = spans.get(&error.file_name)?;
            let around = file.iter().filter(|span| span.range.contains(&error.byte_start));
            around.min_by_key(|span| span.range.len()).map(|span| span.mutants.clone().collect())
        };
        // Where a value is missing, the compiler points at its use, and names the place that left it out.
        let cause =
            |error: &&ErrorSpan| error.label.as_ref().is_some_and(|label| label.contains("not initialized"));
        let causes = self.spans.iter().filter(cause).find_map(|error| inside(&error));
        let primary = || self.spans.iter().filter(|error| error.is_primary).find_map(|error| inside(&error));
        let other = || self.spans.iter().find_map(|error| inside(&error));
        causes.or_else(primary).or_else(other).unwrap_or_default()
    }
}

fn in_scope(name: &str) -> bool {
    let within =
        |path: &str| name.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    // A file `no_...` stands for a feature that is off.
    let is_built = !name.contains("tests") && !name.contains("/no_");
    name.ends_with(".rs") && is_built && PATHS.iter().any(|path| within(path))
}

/// Lets a mutated package know the switch.
fn with_switch(name: &str, manifest: Vec<u8>) -> Vec<u8> {
    let folder = Path::new(name).parent().unwrap_or(Path::new(""));
    if !PACKAGES.iter().any(|(_, of)| Path::new(of) == folder) {
        return manifest;
    }
    let up = "../".repeat(folder.components().count());
    let text = String::from_utf8_lossy(&manifest);
    let dependency = format!("[dependencies]\n{SWITCH} = {{ path = \"{up}{SWITCH}\" }}");
    text.replacen("[dependencies]", &dependency, 1).into_bytes()
}

/// Leaves a file alone that has these bytes: cargo builds anew what is younger.
fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    if std::fs::read(path).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    let folder = path.parent().unwrap_or(Path::new("/"));
    let done = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(path, bytes));
    done.map_err(|error| format!("{}: {error}", path.display()))
}

fn copy_mode(from: &Path, to: &Path) -> Result<(), String> {
    let done = std::fs::metadata(from).and_then(|data| std::fs::set_permissions(to, data.permissions()));
    done.map_err(|error| format!("{}: {error}", to.display()))
}

fn remove_others(folder: &Path, kept: &HashSet<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            remove_others(&path, kept)?;
        } else if !kept.contains(&path) && path.file_name().is_some_and(|name| name != "Cargo.lock") {
            std::fs::remove_file(&path)?;
        }
    }
    Ok(())
}

fn output(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    if !output.status.success() {
        return Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr)));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
