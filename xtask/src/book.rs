//! The documents as a book (mdBook), and checks of each document: links resolve, fenced blocks have a tag, table cells are short,
//! and the contents come first.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::install::{self, Group};
use crate::tools::{Outcome, built, command, root, run};

const REPOSITORY: &str = concat!(env!("CARGO_PKG_REPOSITORY"), "/blob/main");
const CELL_CHARS_MAX: usize = 200;

/// Checks the documents, then builds the book into target/book unless `check` is set.
pub(crate) fn make(check: bool) -> Outcome {
    let files = documents()?;
    let texts = files
        .iter()
        .map(|file| Ok((file.clone(), Document::read(file)?)))
        .collect::<Outcome<HashMap<_, _>>>()?;
    let mut faults = Vec::new();
    for file in &files {
        let name = file.strip_prefix(root()).unwrap_or(file).display();
        let mut of_file = texts[file].faults(file.starts_with(root().join("docs")));
        of_file.extend(
            texts[file].links.iter().filter_map(|(line, link)| {
                dead(file, link, &texts).map(|why| format!("{line}: {link}: {why}"))
            }),
        );
        faults.extend(of_file.into_iter().map(|fault| format!("{name}:{fault}")));
    }
    faults.extend(not_in_the_summary(&texts)?);
    faults.iter().for_each(|fault| eprintln!("{fault}"));
    if !faults.is_empty() {
        return Err(format!("{} faults in the documents", faults.len()));
    }
    println!("{} documents checked", files.len());
    if check {
        return Ok(());
    }
    install::check(&[Group::Book])?;
    stage()?;
    run(&mut command("mdbook", &["build"]))?;
    built("target/book/index.html")
}

/// Copies docs/ for mdBook, which sees no other files: links from there to those are pointed at the repository.
fn stage() -> Outcome {
    copy(&root().join("docs"), &root().join("target/docs"), "](../")?;
    copy(&root().join("docs/examples"), &root().join("target/docs/examples"), "](../../")
}

/// Copies the files in the folder `from`, from where links out of docs/ begin with `out`.
fn copy(from: &Path, to: &Path, out: &str) -> Outcome {
    let fault = |error: std::io::Error| format!("{}: {error}", to.display());
    std::fs::create_dir_all(to).map_err(fault)?;
    for file in from.read_dir().map_err(fault)? {
        let file = file.map_err(fault)?.path();
        if file.is_file() {
            let text = std::fs::read_to_string(&file).map_err(fault)?;
            let text = text.replace(out, &format!("]({REPOSITORY}/"));
            std::fs::write(to.join(file.file_name().unwrap_or_default()), text).map_err(fault)?;
        }
    }
    Ok(())
}

/// The Markdown files that git tracks or would track.
fn documents() -> Outcome<Vec<PathBuf>> {
    let files = crate::tools::output(&mut command(
        "git",
        &["ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
    ))?;
    Ok(files.lines().map(|file| root().join(file)).filter(|file| file.exists()).collect())
}

/// Documents missing from the book.
fn not_in_the_summary(texts: &HashMap<PathBuf, Document>) -> Outcome<Vec<String>> {
    let summary = root().join("docs/SUMMARY.md");
    let listed = &texts.get(&summary).ok_or("docs/SUMMARY.md is missing")?.links;
    let docs = texts.keys().filter(|file| **file != summary);
    let names = docs.filter_map(|file| file.strip_prefix(root().join("docs")).ok()?.to_str());
    let missing = names.filter(|name| !listed.iter().any(|(_, link)| link == name));
    Ok(missing.map(|name| format!("docs/SUMMARY.md: lacks {name}")).collect())
}

/// Why a link of `file` is broken, if it is. External links are not checked.
fn dead(file: &Path, link: &str, texts: &HashMap<PathBuf, Document>) -> Option<String> {
    if link.contains("://") || link.starts_with("mailto:") {
        return None;
    }
    let (path, anchor) = link.split_once('#').map_or((link, None), |(path, anchor)| (path, Some(anchor)));
    let target = if path.is_empty() { file.to_owned() } else { file.with_file_name("").join(path) };
    let Ok(target) = target.canonicalize() else { return Some("no such file".into()) };
    let anchor = anchor?;
    let known = texts.get(&target).is_some_and(|text| text.anchors.iter().any(|of| of == anchor));
    (!known).then(|| "no such heading".into())
}

/// The checked contents of a Markdown file.
#[derive(Default)]
struct Document {
    /// Anchors of the headings.
    anchors: Vec<String>,
    /// Links with their line numbers.
    links: Vec<(usize, String)>,
    /// Line numbers of fences without a tag.
    untagged: Vec<usize>,
    /// Line numbers of long cells, with their lengths.
    long: Vec<(usize, usize)>,
    sections: usize,
    /// Whether links to the document's headings come before the first section.
    contents: bool,
}

impl Document {
    fn read(file: &Path) -> Outcome<Self> {
        let text = std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
        Ok(Self::of(&text))
    }

    fn of(text: &str) -> Self {
        let mut document = Self::default();
        let mut fenced = false;
        for (line, number) in text.lines().zip(1..) {
            if let Some(tag) = line.strip_prefix("```") {
                if !fenced && tag.is_empty() {
                    document.untagged.push(number);
                }
                fenced = !fenced;
            } else if !fenced {
                document.line(number, line);
            }
        }
        document
    }

    /// Parses a line outside of fences.
    fn line(&mut self, number: usize, line: &str) {
        let level = line.len() - line.trim_start_matches('#').len();
        if level > 0 && line[level..].starts_with(' ') {
            self.sections += usize::from(level == 2);
            self.heading(&line[level + 1..]);
        }
        if line.starts_with('|') {
            let cells = line.replace("\\|", "/");
            let long = cells
                .split('|')
                .map(|cell| cell.trim().chars().count())
                .filter(|chars| *chars > CELL_CHARS_MAX);
            self.long.extend(long.map(|chars| (number, chars)));
        }
        // Code may look like a link.
        let prose: String = line.split('`').step_by(2).collect();
        for link in prose.split("](").skip(1).filter_map(|behind| behind.split(')').next()) {
            self.contents |= self.sections == 0 && link.starts_with('#');
            self.links.push((number, link.to_owned()));
        }
    }

    /// Anchors as GitHub and mdBook make them: lower case, no punctuation, hyphens for spaces; a number for repeated names.
    fn heading(&mut self, text: &str) {
        let kept = text.chars().filter(|of| of.is_alphanumeric() || matches!(of, ' ' | '-' | '_'));
        let name = kept.collect::<String>().trim().to_lowercase().replace(' ', "-");
        let again = (1..).map(|nth| format!("{name}-{nth}"));
        let anchor = std::iter::once(name.clone()).chain(again).find(|of| !self.anchors.contains(of));
        self.anchors.extend(anchor);
    }

    fn faults(&self, chapter: bool) -> Vec<String> {
        let untagged =
            self.untagged.iter().map(|line| format!("{line}: the block does not say what it is: ```text"));
        let long = self
            .long
            .iter()
            .map(|(line, chars)| format!("{line}: a cell of {chars} characters, {CELL_CHARS_MAX} at most"));
        let bare = chapter && self.sections > 0 && !self.contents;
        untagged.chain(long).chain(bare.then(|| "1: no contents on top".into())).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::path::Path;

    use super::{Document, dead};

    #[test]
    fn untagged_blocks_long_cells_and_missing_contents_are_faults() {
        let text = format!("# A\n\n## B\n\n```\nx\n```\n\n| {} |\n\n## C\n", "x".repeat(201));
        assert_eq!(
            Document::of(&text).faults(true),
            [
                "5: the block does not say what it is: ```text",
                "9: a cell of 201 characters, 200 at most",
                "1: no contents on top",
            ]
        );
        let text = "# A\n\n- [B](#b)\n\n## B\n\n```sh\n# no heading\n```\n\n| `a|b` |\n\n## C\n";
        assert!(Document::of(text).faults(true).is_empty());
    }

    #[test]
    fn a_link_leads_to_a_file_or_a_heading() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/book.rs").canonicalize().unwrap();
        let text = Document::of(
            "# `show units`: a list\n## Ports\n## Ports\n[x](#ports-1) `[y](nowhere)` [z](main.rs)",
        );
        assert_eq!(text.anchors, ["show-units-a-list", "ports", "ports-1"]);
        assert_eq!(text.links, [(4, "#ports-1".to_owned()), (4, "main.rs".to_owned())]);
        let texts = HashMap::from([(file.clone(), text)]);
        assert_eq!(dead(&file, "#ports-1", &texts), None);
        assert_eq!(dead(&file, "main.rs", &texts), None);
        assert_eq!(dead(&file, "https://example.com/nothing", &texts), None);
        assert_eq!(dead(&file, "#ports-2", &texts).as_deref(), Some("no such heading"));
        assert_eq!(dead(&file, "nothing.md", &texts).as_deref(), Some("no such file"));
    }
}
