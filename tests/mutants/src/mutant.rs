//! A mutant, and the list of those that are no fault.

use std::collections::HashSet;
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
        format!("{}: {}: {}", self.file, self.source, self.change)
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

/// Mutants that behave as the original does, each with the reason, in `equivalent.toml`. They are found by what they
/// are, not by the number of their line.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Equivalent {
    file: String,
    line: String,
    change: String,
    /// Why nobody could notice; for people.
    #[serde(rename = "reason")]
    _reason: String,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct List {
    #[serde(default)]
    mutant: Vec<Equivalent>,
}

impl Equivalent {
    /// Whether this is meant.
    pub(crate) fn is(&self, mutant: &Mutant) -> bool {
        self.file == mutant.file && self.line == mutant.source && self.change == mutant.change
    }
}

/// Reads the list. An entry that no longer says which mutant it means is an error: its code was changed, or left the scope.
pub(crate) fn equivalent(path: &Path, all: &[Mutant]) -> Result<Vec<Equivalent>, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let list: List = toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    let there: HashSet<(&str, &str, &str)> =
        all.iter().map(|mutant| (&*mutant.file, &*mutant.source, &*mutant.change)).collect();
    let is_stale = |entry: &&Equivalent| !there.contains(&(&*entry.file, &*entry.line, &*entry.change));
    let stale = list.mutant.iter().filter(is_stale);
    let stale: Vec<_> =
        stale.map(|Equivalent { file, line, change, .. }| format!("{file}: `{line}`: {change}")).collect();
    if stale.is_empty() {
        Ok(list.mutant)
    } else {
        Err(format!("{}: no longer there:\n{}", path.display(), stale.join("\n")))
    }
}
