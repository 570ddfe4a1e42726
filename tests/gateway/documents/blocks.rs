//! Fenced blocks of README.md, docs/*.md and docs/examples/*.md, with what the comment above them adds that readers need not see:
//!
//! ```text
//! <!-- with
//! port P1 serial /dev/ttyUSB0 rtu client 19200 8E1
//! units 3 7 on /dev/ttyUSB0 9600 8N1
//! -->
//! ```

use std::path::Path;

/// A fenced block.
pub(crate) struct Block {
    /// File and line, for messages.
    pub(crate) place: String,
    /// What is behind the backquotes.
    pub(crate) tag: String,
    /// The lines of the comment above it.
    pub(crate) with: Vec<String>,
    pub(crate) lines: Vec<String>,
}

/// All blocks that have this tag; `root` is the repository.
pub(crate) fn blocks(root: &Path, tag: &str) -> Vec<Block> {
    let in_folder = |name| root.join(name).read_dir().unwrap().map(|entry| entry.unwrap().path());
    let docs = in_folder("docs").chain(in_folder("docs/examples"));
    let mut files: Vec<_> = docs.chain([root.join("README.md")]).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "md"));
    files.sort();
    let all = files.iter().flat_map(|file| {
        let name = file.strip_prefix(root).unwrap().display().to_string();
        of_text(&name, &std::fs::read_to_string(file).unwrap())
    });
    let found: Vec<_> = all.filter(|block| block.tag == tag).collect();
    assert!(!found.is_empty(), "no document has a block of {tag}");
    found
}

fn of_text(name: &str, text: &str) -> Vec<Block> {
    let (mut blocks, mut with) = (Vec::new(), Vec::new());
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let mut until = |end: &str| -> Vec<String> {
            lines.by_ref().map(|(_, line)| line.to_owned()).take_while(|line| line != end).collect()
        };
        if line == "<!-- with" {
            with = until("-->");
        } else if let Some(tag) = line.strip_prefix("```") {
            let (place, with) = (format!("{name}:{}", number + 1), std::mem::take(&mut with));
            blocks.push(Block { place, tag: tag.to_owned(), with, lines: until("```") });
        }
    }
    blocks
}
