//! Compresses the web page's files into one response each, so that a browser needs few round trips. Without the feature `page`
//! nothing is done.
//!
//! The page's ES modules are joined in the order of their imports: `import` lines and the word `export` go, as all names of the
//! page are unique. That is all: what is served is what is in `src/web/page`.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Boards without the page have no use for the compressor.
    #[cfg(feature = "page")]
    page::build();
}

#[cfg(feature = "page")]
mod page {
    use std::fmt::Write as _;
    use std::io::Write as _;
    use std::path::Path;
    use std::{env, fs};

    use flate2::{Compression, GzBuilder};

    const FOLDER: &str = "src/web/page";
    /// The module that imports the others.
    const MAIN: &str = "main.js";

    /// Writes the table `FILES` of src/web/page.rs, and the files that it includes.
    pub(crate) fn build() {
        println!("cargo::rerun-if-changed={FOLDER}");
        let out = env::var("OUT_DIR").expect("cargo sets it");
        let mut script = String::new();
        join(MAIN, &mut Vec::new(), &mut script);
        check(&script);
        let mut table = "&[\n".to_owned();
        for (path, file, kind, content) in [
            ("/", "index.html", "text/html; charset=utf-8", read("index.html")),
            ("/page.css", "page.css", "text/css; charset=utf-8", read("page.css")),
            ("/page.js", "page.js", "text/javascript; charset=utf-8", script),
            ("/icon.svg", "icon.svg", "image/svg+xml", read("icon.svg")),
        ] {
            // Without a time in its head: the same sources give the same bytes.
            let mut packed = GzBuilder::new().write(Vec::new(), Compression::best());
            packed.write_all(content.as_bytes()).expect("memory");
            let packed = packed.finish().expect("memory");
            let target = Path::new(&out).join(format!("{file}.gz"));
            fs::write(&target, &packed).unwrap_or_else(|error| panic!("{}: {error}", target.display()));
            let tag = fnv(&packed);
            writeln!(
                table,
                "File {{ path: {path:?}, kind: {kind:?}, tag: \"\\\"{tag:016x}\\\"\", \
                 bytes: include_bytes!({:?}) }},",
                target.display().to_string()
            )
            .expect("memory");
        }
        table.push(']');
        let target = Path::new(&out).join("page.rs");
        fs::write(&target, table).unwrap_or_else(|error| panic!("{}: {error}", target.display()));
    }

    fn read(file: &str) -> String {
        let path = Path::new(FOLDER).join(file);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Appends a module, once, behind those that it imports.
    fn join(file: &str, joined: &mut Vec<String>, script: &mut String) {
        if joined.iter().any(|known| known == file) {
            return;
        }
        joined.push(file.to_owned());
        let (mut own, mut in_import) = (String::new(), false);
        for line in read(file).lines() {
            in_import |= line.starts_with("import ");
            if !in_import {
                own.push_str(line.strip_prefix("export ").unwrap_or(line));
                own.push('\n');
                continue;
            }
            if let Some((_, from)) = line.split_once("from \"./") {
                join(from.trim_end_matches("\";"), joined, script);
            }
            in_import = !line.ends_with(';');
        }
        script.push_str(&own);
    }

    /// Fails if two modules declare the same name, which a browser would say of the whole script only.
    fn check(script: &str) {
        let mut names = Vec::new();
        for line in script.lines() {
            let line = line.strip_prefix("async ").unwrap_or(line);
            let kind =
                ["function ", "let ", "const ", "class "].into_iter().find(|kind| line.starts_with(kind));
            let rest = kind.and_then(|kind| line.strip_prefix(kind)).unwrap_or_default();
            let declared = rest.split(['=', '(', '{']).next().unwrap_or_default();
            let words = declared.split(|char: char| !char.is_alphanumeric() && char != '_');
            for name in words.filter(|word| !word.is_empty()) {
                assert!(!names.contains(&name), "{FOLDER}: two modules declare {name}");
                names.push(name);
            }
        }
    }

    /// FNV-1a: tells two versions of a file apart.
    fn fnv(bytes: &[u8]) -> u64 {
        bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }
}
