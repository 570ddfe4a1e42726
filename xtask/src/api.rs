//! The public items of the library crates as declared: `xtask/api` lists them, so that changes are noticed.
//!
//! rustdoc's JSON says what is public and where it is declared; the declarations come from there. Needs no other toolchain.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::tools::{Outcome, command, figure, read, root, run};

/// Packages that others build upon.
const PACKAGES: [&str; 2] = ["mobgate", "ethercat-subdevice"];

/// Compares the lists with the current items, or writes them.
pub(crate) fn check(write: bool) -> Outcome {
    let mut changed = Vec::new();
    for package in PACKAGES {
        let now = list(package)?;
        println!("{package}: {} public items", now.lines.len());
        if package == "mobgate" {
            figure("core_public_items", now.items as f64, "items", Some(400.0));
        }
        let now = now.lines;
        let file = format!("xtask/api/{package}.txt");
        let text: String = now.iter().flat_map(|line| [line, "\n"]).collect();
        if write {
            let file = root().join(file);
            std::fs::write(&file, text).map_err(|error| format!("{}: {error}", file.display()))?;
            continue;
        }
        let listed = read(&file)?;
        let listed: BTreeSet<&str> = listed.lines().collect();
        let now: BTreeSet<&str> = now.iter().map(String::as_str).collect();
        changed.extend(listed.difference(&now).map(|line| format!("- {line}")));
        changed.extend(now.difference(&listed).map(|line| format!("+ {line}")));
    }
    changed.iter().for_each(|line| eprintln!("{line}"));
    match changed.len() {
        0 => Ok(()),
        count => Err(format!("{count} public items are not as listed: cargo xtask api --write")),
    }
}

fn list(package: &str) -> Outcome<Listed> {
    // A separate target folder: some crates depend on the variable below, and would be rebuilt.
    let words =
        ["rustdoc", "--quiet", "--locked", "--lib", "--target-dir", "target/api", "--package", package];
    let mut cargo = command("cargo", &words);
    // rustdoc's JSON format is unstable.
    run(cargo.args(["--", "-Zunstable-options", "--output-format", "json"]).env("RUSTC_BOOTSTRAP", "1"))?;
    let name = package.replace('-', "_");
    let text = read(format!("target/api/doc/{name}.json"))?;
    let json: Value = serde_json::from_str(&text).map_err(|error| format!("{name}.json: {error}"))?;
    let mut api = Api { index: &json["index"], listed: Listed::default() };
    api.item(&json["root"], "");
    Ok(api.listed)
}

/// The public, documented items of a crate; hidden ones are for its own tests.
#[derive(Default)]
struct Listed {
    lines: BTreeSet<String>,
    /// Items with a page or heading of their own: no fields, variants or trait methods.
    items: usize,
}

struct Api<'j> {
    index: &'j Value,
    listed: Listed,
}

impl Api<'_> {
    /// Lists an item visible at `path`, and the items within it.
    fn item(&mut self, id: &Value, path: &str) {
        let item = &self.index[id.to_string()];
        let Some((kind, inner)) = item["inner"].as_object().and_then(|inner| inner.iter().next()) else {
            return;
        };
        let visible = matches!(item["visibility"].as_str(), Some("public" | "default"));
        if !visible {
            return;
        }
        if kind == "use" {
            self.import(inner, path);
            return;
        }
        let name = item["name"].as_str().unwrap_or_default();
        let own = if path.is_empty() { name.to_owned() } else { format!("{path}::{name}") };
        if kind != "impl" && kind != "module" {
            let is_new = self.listed.lines.insert(format!("{own}: {}", declaration(&item["span"], kind)));
            let is_item = item["visibility"] == "public" && kind != "struct_field";
            self.listed.items += usize::from(is_new && is_item);
        }
        let inside = if kind == "impl" { path } else { &own };
        let parts = ["items", "impls", "variants"].map(|part| &inner[part]);
        let fields =
            [&inner["kind"]["plain"]["fields"], &inner["kind"]["tuple"], &inner["kind"]["struct"]["fields"]];
        for part in parts.into_iter().chain(fields).filter_map(Value::as_array).flatten() {
            // Implementations of traits are visible through the trait.
            if self.index[part.to_string()]["inner"]["impl"]["trait"].is_null() {
                self.item(part, inside);
            }
        }
    }

    /// An imported item is visible here under its new name.
    fn import(&mut self, import: &Value, path: &str) {
        if import["is_glob"] == true {
            for id in self.index[import["id"].to_string()]["inner"]["module"]["items"]
                .as_array()
                .into_iter()
                .flatten()
            {
                self.item(id, path);
            }
            return;
        }
        let name = import["name"].as_str().unwrap_or_default();
        if self.index[import["id"].to_string()].is_null() {
            // From another crate.
            let source = import["source"].as_str().unwrap_or_default();
            self.listed.lines.insert(format!("{path}::{name}: use {source}"));
        }
        self.item(&import["id"], path);
    }
}

/// An item's declaration in its file.
fn declaration(span: &Value, kind: &str) -> String {
    let file = Path::new(span["filename"].as_str().unwrap_or_default());
    let number = |of: &Value, nth: usize| of[nth].as_u64().unwrap_or(1) as usize;
    let (begin, end) = (&span["begin"], &span["end"]);
    let text = read(file).unwrap_or_default();
    let lines = text.lines().take(number(end, 0)).skip(number(begin, 0).saturating_sub(1));
    let text: Vec<&str> = lines.collect();
    let text = text.join("\n");
    head(text.get(number(begin, 1).saturating_sub(1)..).unwrap_or(&text), kind)
}

/// The text up to its body or end, in one line.
fn head(text: &str, kind: &str) -> String {
    let (mut depth, mut before) = (0_i32, ' ');
    let end = text.find(|character| {
        // Public fields are listed on their own lines; a field ends at the comma.
        let stop = match kind {
            "struct" => '(',
            "struct_field" => ',',
            _ => '{',
        };
        if depth == 0 && character == stop {
            return true;
        }
        match character {
            '(' | '[' | '<' => depth += 1,
            '>' if before == '-' => {}
            ')' | ']' | '>' => depth -= 1,
            _ => {}
        }
        before = character;
        // The value of a constant is not part of its interface.
        depth < 0 || depth == 0 && matches!(character, '{' | ';' | '=')
    });
    let words = text[..end.unwrap_or(text.len())].split_whitespace().collect::<Vec<_>>();
    words.join(" ").trim_end_matches(',').to_owned()
}

#[cfg(test)]
mod tests {
    use super::head;

    #[test]
    fn a_declaration_ends_before_what_callers_do_not_see() {
        for (kind, text, shown) in [
            ("struct", "pub struct Slot(pub(super) Mutex<u8>);", "pub struct Slot"),
            ("struct", "pub struct Row<F: Fn(u8) -> u8> {\n    own: F,", "pub struct Row<F: Fn(u8) -> u8>"),
            ("struct_field", "pub u16);", "pub u16"),
            ("struct_field", "Misfit, Result<u8, ()>)", "Misfit"),
            ("struct_field", "pub rows: [u8; 4],", "pub rows: [u8; 4]"),
            ("variant", "Up(AlState),", "Up(AlState)"),
            ("constant", "pub const ROWS: [u8; 2] = [1, 2];", "pub const ROWS: [u8; 2]"),
            ("function", "pub fn of(\n    id: u8,\n) -> Option<u8> {", "pub fn of( id: u8, ) -> Option<u8>"),
        ] {
            assert_eq!(head(text, kind), shown);
        }
    }
}
