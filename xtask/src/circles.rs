//! `cargo xtask circles`: the imports between files of each crate, which must not form a circle.
//!
//! A file imports another if it names an item that the other defines, however it is re-exported. It does not if it only
//! declares or re-exports, and tests are ignored. In [`FOLDERS`] a folder stands for its files, and is held to the same.
//!
//! Files are read as tokens: a field or a variant counts as an import if a glob brings an item of its name into scope.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::mem;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use proc_macro2::{Delimiter, Punct, Spacing, TokenStream, TokenTree};
use serde_json::Value;

use crate::cargo::cargo;
use crate::process::output;
use crate::workspace::{ALONE, root};

/// The packages whose folders have no circle either.
const FOLDERS: [&str; 1] = ["armwire-host"];

/// Checks each target of each package.
///
/// # Errors
///
/// If a file cannot be read, or imports form a circle: their files, and the names that each imports.
pub(crate) fn check() -> Result<()> {
    let mut circles = BTreeSet::new();
    let mut files = 0;
    for workspace in [""].into_iter().chain(ALONE) {
        let metadata = format!("metadata --no-deps --format-version 1 {workspace}");
        let metadata: Value = serde_json::from_str(&output(&mut cargo(&metadata))?)?;
        for package in metadata["packages"].as_array().context("no packages")? {
            for target in package["targets"].as_array().into_iter().flatten() {
                let file = target["src_path"].as_str().context("a target without a file")?;
                let imports = Crate::read(Path::new(file))?.imports();
                files += imports.len();
                circles.extend(circles_of_files(&imports));
                if FOLDERS.iter().any(|name| package["name"] == *name) {
                    circles.extend(circles_of_folders(&imports));
                }
            }
        }
    }
    println!("{files} files");
    let circles: Vec<_> = circles.into_iter().collect();
    ensure!(circles.is_empty(), "imports in circles:\n\n{}", circles.join("\n"));
    Ok(())
}

/// The names that each file imports from each other file. Every file has an entry.
type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, BTreeSet<String>>>;

/// The circles of files, each as text.
fn circles_of_files(imports: &Imports) -> Vec<String> {
    let mut rest: BTreeSet<_> = imports.keys().collect();
    let mut circles = Vec::new();
    while let Some(first) = rest.pop_first() {
        let mut circle = reached(imports, first);
        circle.retain(|file| reached(imports, file).contains(first));
        rest.retain(|file| !circle.contains(file));
        let mut text = format!("{} files:\n", circle.len());
        for from in &circle {
            for (to, names) in imports[*from].iter().filter(|(to, _)| circle.contains(to)) {
                let names: Vec<_> = names.iter().map(String::as_str).collect();
                text += &format!("{} -> {}: {}\n", shown(from), shown(to), names.join(", "));
            }
        }
        circles.extend(Some(text).filter(|_| !circle.is_empty()));
    }
    circles
}

/// The circles between the files and folders in each folder, as text.
fn circles_of_folders(imports: &Imports) -> Vec<String> {
    let folders: BTreeSet<_> = imports.keys().flat_map(|file| file.ancestors().skip(1)).collect();
    let circles = folders.into_iter().flat_map(|folder| {
        // The entry of the folder that a file is, or lies in.
        let entry = |file: &Path| Some(folder.join(file.strip_prefix(folder).ok()?.components().next()?));
        let mut entries = Imports::new();
        for (from, imported) in imports {
            for (to, names) in imported {
                let both = entry(from).zip(entry(to)).filter(|(from, to)| from != to);
                let Some((from, to)) = both else { continue };
                entries.entry(to.clone()).or_default();
                let all = entries.entry(from).or_default().entry(to).or_default();
                all.extend(names.iter().cloned());
            }
        }
        circles_of_files(&entries)
    });
    circles.collect()
}

/// The files that a file imports, directly or not.
fn reached<'a>(imports: &'a Imports, from: &Path) -> BTreeSet<&'a PathBuf> {
    let mut open: Vec<_> = imports[from].keys().collect();
    let mut reached = BTreeSet::new();
    while let Some(file) = open.pop() {
        if reached.insert(file) {
            open.extend(imports[file].keys());
        }
    }
    reached
}

/// A file as seen from the workspace.
fn shown(file: &Path) -> impl std::fmt::Display {
    file.strip_prefix(root()).unwrap_or(file).display()
}

/// The names of a path.
type Names = Vec<String>;

/// A module, or an item in it.
type Meaning = (usize, Option<String>);

/// The modules that each module has a name for: the root, itself and its parent.
const ROOTS: [&str; 3] = ["crate", "self", "super"];

/// The modules of a target, by number. The root is the first.
#[derive(Default)]
struct Crate {
    /// The file of each module, and the folder of its modules' files.
    modules: Vec<(PathBuf, PathBuf)>,
    /// The names in the scope of each module. Configurations may have different ones.
    scope: BTreeMap<(usize, String), BTreeSet<Meaning>>,
    /// The paths that a module imports or re-exports, and the name that each gets: `*` if it is a glob.
    uses: Vec<(usize, String, Names)>,
    /// The paths in the code of a module, without re-exports.
    paths: Vec<(usize, Names)>,
}

impl Crate {
    /// Reads all modules of a target.
    fn read(root: &Path) -> Result<Self> {
        let mut all = Self::default();
        all.read_module(tokens(root)?, root.to_owned(), root.with_file_name(""), 0)?;
        all.link();
        Ok(all)
    }

    fn read_module(&mut self, tokens: TokenStream, file: PathBuf, folder: PathBuf, parent: usize) -> Result<()> {
        let nth = self.modules.len();
        self.modules.push((file, folder));
        for (name, module) in ROOTS.into_iter().zip([0, nth, parent]) {
            self.define(nth, name, (module, None));
        }
        self.read_tokens(tokens, nth, true)
    }

    /// Reads a module in another from its body, the file that an attribute names, or its file.
    fn read_submodule(&mut self, name: &str, body: TokenTree, named: Option<String>, parent: usize) -> Result<()> {
        self.define(parent, name, (self.modules.len(), None));
        let (file, folder) = &self.modules[parent];
        let folder = folder.join(name);
        let beside = folder.with_extension("rs");
        let (file, folder) = match (body, named) {
            (TokenTree::Group(body), _) => return self.read_module(body.stream(), file.clone(), folder, parent),
            (_, Some(named)) => {
                let file = file.with_file_name(named).canonicalize()?;
                let folder = file.with_file_name("");
                (file, folder)
            }
            _ if beside.exists() => (beside, folder),
            _ => (folder.join("mod.rs"), folder),
        };
        self.read_module(tokens(&file)?, file, folder, parent)
    }

    /// Adds the names and paths in tokens of a module. Items and modules are at its `top` only, or in a macro there; the
    /// imports of a function count as the module's.
    fn read_tokens(&mut self, tokens: TokenStream, nth: usize, top: bool) -> Result<()> {
        let mut tokens = tokens.into_iter();
        // The path that may go on, the punctuation since its last word, and whether the name of an item follows.
        let (mut path, mut before, mut is_item) = (Names::new(), String::new(), false);
        // The file that an attribute names.
        let mut named = None;
        while let Some(token) = tokens.next() {
            match token {
                TokenTree::Ident(word) => {
                    let word = word.to_string();
                    let mut ended = Names::new();
                    if before != "::" {
                        mem::swap(&mut path, &mut ended);
                    }
                    match (word.as_str(), before.as_str()) {
                        ("_" | "async" | "extern" | "mut" | "unsafe", _) => {}
                        ("const" | "enum" | "fn" | "macro_rules" | "static", "" | ";") => is_item = top,
                        ("struct" | "trait" | "type" | "union", "" | ";") => is_item = top,
                        ("use", _) => {
                            let tree = tokens.by_ref().take_while(|token| token.to_string() != ";");
                            self.read_use(tree.collect(), &[], nth, ended == ["pub"]);
                        }
                        ("mod", _) if top => {
                            let name = tokens.next().context("a module without a name")?.to_string();
                            let body = tokens.next().context("a module without a body")?;
                            self.read_submodule(&name, body, named.take(), nth)?;
                        }
                        (_, before) => {
                            if mem::take(&mut is_item) && matches!(before, "" | "!") {
                                self.define(nth, &word, (nth, Some(word.clone())));
                            }
                            path.extend(Some(word).filter(|_| before != "."));
                        }
                    }
                    self.paths.push((nth, ended));
                }
                TokenTree::Punct(punct) => {
                    before.push(punct.as_char());
                    continue;
                }
                // A path in it is a module, and may also name a function.
                TokenTree::Group(_) if path == ["pub"] => {}
                TokenTree::Group(group) => match group.to_string().replace(' ', "") {
                    text if text.starts_with("[cfg(test") || text.starts_with("[cfg(all(test") => {
                        tokens.find(ends_item);
                    }
                    text if text.starts_with("[path=") => named = text.split('"').nth(1).map(str::to_owned),
                    _ => self.read_tokens(group.stream(), nth, top && before == "!")?,
                },
                TokenTree::Literal(_) => {}
            }
            before.clear();
        }
        self.paths.push((nth, path));
        Ok(())
    }

    /// Adds the paths in the tree of a `use` behind a prefix. A path may end with `*`, `self`, or `as` and a name.
    fn read_use(&mut self, tree: TokenStream, prefix: &[String], nth: usize, is_re_export: bool) {
        let mut path = prefix.to_vec();
        for token in tree.into_iter().chain([Punct::new(',', Spacing::Alone).into()]) {
            match token {
                TokenTree::Group(group) => self.read_use(group.stream(), &mem::take(&mut path), nth, is_re_export),
                TokenTree::Punct(punct) if punct.as_char() == ',' => {
                    let mut path = mem::replace(&mut path, prefix.to_vec());
                    let Some(mut name) = path.pop() else { continue };
                    match path.last() {
                        Some(last) if last == "as" => _ = path.pop(),
                        Some(last) if name == "self" => name.clone_from(last),
                        _ if name == "*" => {}
                        _ => path.push(name.clone()),
                    }
                    self.paths.extend(Some((nth, path.clone())).filter(|_| !is_re_export));
                    self.uses.push((nth, name, path));
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' => {}
                word => path.push(word.to_string()),
            }
        }
    }

    fn define(&mut self, nth: usize, name: &str, meaning: Meaning) {
        self.scope.entry((nth, name.to_owned())).or_default().insert(meaning);
    }

    /// Gives the imported names their meanings. They may be imported themselves, so that it takes several rounds.
    fn link(&mut self) {
        let count = |all: &Self| all.scope.values().map(BTreeSet::len).sum::<usize>();
        let mut before = 0;
        while before != count(self) {
            before = count(self);
            for (nth, name, path) in self.uses.clone() {
                for meaning in self.meanings(nth, &path) {
                    if name != "*" {
                        self.define(nth, &name, meaning);
                    } else if let (from, None) = meaning {
                        for ((module, name), meanings) in self.scope.clone() {
                            if module == from && !ROOTS.contains(&name.as_str()) {
                                self.scope.entry((nth, name)).or_default().extend(meanings);
                            }
                        }
                    }
                }
            }
        }
    }

    /// The meanings of a path in a module; none if it is another crate's, or a local name. A path that goes on behind an
    /// item stands for the item, unless a module has the same name.
    fn meanings(&self, nth: usize, path: &[String]) -> BTreeSet<Meaning> {
        let mut found = BTreeSet::from([(nth, None)]);
        for name in path {
            let modules = found.iter().filter(|(_, item)| item.is_none());
            let mut scopes = modules.map(|(nth, _)| self.scope.get(&(*nth, name.clone()))).peekable();
            if scopes.peek().is_none() {
                break;
            }
            found = scopes.flatten().flatten().cloned().collect();
        }
        found
    }

    /// The names that the files import from each other.
    fn imports(&self) -> Imports {
        let file = |nth: usize| self.modules[nth].0.clone();
        let files = self.modules.iter().map(|(file, _)| file.clone());
        let mut imports: Imports = files.map(|file| (file, BTreeMap::new())).collect();
        for (nth, path) in &self.paths {
            for (from, item) in self.meanings(*nth, path) {
                if let Some(item) = item.filter(|_| file(from) != file(*nth)) {
                    let imported = imports.entry(file(*nth)).or_default();
                    imported.entry(file(from)).or_default().insert(item);
                }
            }
        }
        imports
    }
}

fn tokens(file: &Path) -> Result<TokenStream> {
    let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let tokens = text.parse();
    tokens.map_err(|error| anyhow!("cannot parse {}: {error}", file.display()))
}

/// Returns true if an item, or a statement that is compiled for tests only, ends with the token.
fn ends_item(token: &TokenTree) -> bool {
    match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        token => token.to_string() == ";",
    }
}

#[cfg(test)]
mod tests {
    use std::env::temp_dir;
    use std::process;

    use super::*;
    use crate::files::empty_folder;

    /// The imports of a crate with these files.
    fn imports(name: &str, files: &[(&str, &str)]) -> Imports {
        let folder = temp_dir().join(format!("armwire-circles-{name}-{}", process::id()));
        empty_folder(&folder).unwrap();
        for (file, text) in files {
            let file = folder.join(file);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, text).unwrap();
        }
        let read = Crate::read(&folder.join("lib.rs")).unwrap().imports();
        fs::remove_dir_all(&folder).unwrap();
        let relative = |file: &PathBuf| file.strip_prefix(&folder).unwrap().to_owned();
        let names = |to: BTreeMap<_, _>| to.into_iter().map(|(to, names)| (relative(&to), names)).collect();
        read.into_iter()
            .map(|(from, to)| (relative(&from), names(to)))
            .collect()
    }

    #[test]
    fn circle_is_found_behind_re_exports() {
        let imports = imports(
            "re-exports",
            &[
                ("lib.rs", "mod a; mod b; mod c; pub use a::A;"),
                ("a.rs", "use crate::b; pub struct A(Option<Box<b::B>>);"),
                ("b/mod.rs", "mod inner; pub(crate) use inner::B;"),
                (
                    "b/inner.rs",
                    "pub(crate) struct B; impl B { fn f() -> String { format!(\"{}\", crate::A::g()) } }",
                ),
                ("c.rs", "use crate::{A, b::B}; fn f(a: A, b: B) {}"),
            ],
        );
        assert_eq!(
            circles_of_files(&imports),
            ["2 files:\na.rs -> b/inner.rs: B\nb/inner.rs -> a.rs: A\n"]
        );
    }

    #[test]
    fn declaration_re_export_and_test_are_no_imports() {
        let imports = imports(
            "none",
            &[
                ("lib.rs", "mod a; pub use a::{Child, a}; pub struct Root;"),
                (
                    "a/mod.rs",
                    "mod child; pub use child::Child; pub struct Shared(crate::Root); pub fn a() {}
                     #[cfg(all(test, unix))] mod tests { use super::child::Child; }",
                ),
                (
                    "a/child.rs",
                    "use super::Shared; pub(in crate::a) struct Child(Shared, crate::a::Shared);",
                ),
            ],
        );
        assert_eq!(circles_of_files(&imports), [""; 0]);
        assert_eq!(imports[Path::new("a/child.rs")].len(), 1);
        assert_eq!(imports[Path::new("a/mod.rs")].len(), 1);
    }

    #[test]
    fn folders_may_form_a_circle_without_files() {
        let imports = imports(
            "folders",
            &[
                ("lib.rs", "mod a; mod b;"),
                ("a/mod.rs", "mod low; mod high; pub use low::Low;"),
                ("a/low.rs", "pub struct Low;"),
                ("a/high.rs", "struct High(crate::b::Middle);"),
                ("b/mod.rs", "pub struct Middle(crate::a::Low);"),
            ],
        );
        assert_eq!(circles_of_files(&imports), [""; 0]);
        assert_eq!(
            circles_of_folders(&imports),
            ["2 files:\na -> b: Middle\nb -> a: Low\n"]
        );
    }
}
