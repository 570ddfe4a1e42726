//! A mutant, and the list of those that are no fault.

use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::path::Path;

use serde::Deserialize;

use crate::find::Site;

/// One change of one file.
#[derive(Debug, Clone)]
pub(crate) struct Mutant {
    pub(crate) file: String,
    pub(crate) line: usize,
    /// The line of the source in which it begins.
    pub(crate) source: String,
    pub(crate) change: String,
}

impl Mutant {
    /// What it is, wherever its line has moved.
    pub(crate) fn key(&self) -> String {
        key(&self.file, &self.source, &self.change)
    }
}

impl fmt::Display for Mutant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.change)
    }
}

/// The mutants of a file in the order of `sites`.
pub(crate) fn mutants(file: &str, text: &str, sites: &[Site]) -> Vec<Mutant> {
    let lines: Vec<&str> = text.lines().collect();
    let of_site = |site: &Site| {
        let (line, source) = (site.line, lines[site.line - 1].trim().to_owned());
        let of_change = move |words: &str| Mutant {
            file: file.to_owned(),
            line,
            source: source.clone(),
            change: words.to_owned(),
        };
        site.changes.iter().map(|change| of_change(&change.words)).collect::<Vec<_>>()
    };
    sites.iter().flat_map(of_site).collect()
}

/// Mutants of a line that behave as the original does, for one reason. They are found by what they are, not by the number of their
/// line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Equivalent {
    line: String,
    changes: Vec<String>,
    /// Why nobody could notice; for people.
    #[serde(rename = "reason")]
    _reason: String,
}

/// Reads the list, by file, as keys of mutants. An entry that no longer says which mutant it means is an error: its code was changed,
/// or left the scope.
pub(crate) fn equivalent(path: &Path, all: &[Mutant]) -> Result<HashSet<String>, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let list: BTreeMap<String, Vec<Equivalent>> =
        toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut keys = HashSet::new();
    for (file, entries) in &list {
        for Equivalent { line, changes, .. } in entries {
            keys.extend(changes.iter().map(|change| key(file, line, change)));
        }
    }
    let there = all.iter().map(Mutant::key).collect();
    let stale: Vec<&str> = keys.difference(&there).map(String::as_str).collect();
    if stale.is_empty() {
        Ok(keys)
    } else {
        Err(format!("{}: no longer there:\n{}", path.display(), stale.join("\n")))
    }
}

fn key(file: &str, line: &str, change: &str) -> String {
    format!("{file}: {line}: {change}")
}
