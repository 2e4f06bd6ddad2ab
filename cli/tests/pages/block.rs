//! The `console` blocks of a page in Markdown.

/// The comment in the line before a block whose commands of `armwire` do not run.
const MARKER: &str = "<!-- not run: ";

/// A block.
pub(crate) struct Block {
    /// The line in the page, from 1.
    pub(crate) line: usize,
    /// The reason why it does not run.
    pub(crate) marker: Option<String>,
    pub(crate) examples: Vec<Example>,
}

/// A command of a block, up to a pipe.
pub(crate) struct Example {
    /// Its file name.
    pub(crate) program: String,
    pub(crate) args: Vec<String>,
    /// The file for the output.
    pub(crate) redirection: Option<String>,
    /// The output that the page shows.
    pub(crate) output: Vec<String>,
}

/// The blocks of a page, in order.
pub(crate) fn blocks(page: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut lines = (1..).zip(page.lines());
    let mut before = "";
    while let Some((line, text)) = lines.next() {
        if text == "```console" {
            let reason = before
                .strip_prefix(MARKER)
                .and_then(|reason| reason.strip_suffix(" -->"));
            let body = lines.by_ref().map(|(_, text)| text).take_while(|text| *text != "```");
            blocks.push(Block {
                line,
                marker: reason.map(str::to_owned),
                examples: examples(body),
            });
        }
        before = text;
    }
    blocks
}

fn examples<'a>(mut lines: impl Iterator<Item = &'a str>) -> Vec<Example> {
    let mut examples: Vec<Example> = Vec::new();
    while let Some(line) = lines.next() {
        match (line.strip_prefix("$ "), examples.last_mut()) {
            (Some(command), _) => {
                let mut command = command.to_owned();
                while command.ends_with('\\') {
                    command.pop();
                    command += lines.next().unwrap_or_default();
                }
                examples.push(example(&command));
            }
            (None, Some(last)) => last.output.push(line.to_owned()),
            (None, None) => panic!("'{line}' is no command"),
        }
    }
    examples
}

fn example(command: &str) -> Example {
    let is_variable = |word: &&str| word.contains('=');
    let words = command.split_whitespace().skip_while(is_variable);
    let mut words = words.take_while(|word| !word.starts_with('#') && *word != "|");
    let program = words.next().unwrap_or_else(|| panic!("'{command}' has no program"));
    let program = program.rsplit('/').next().unwrap_or_default().to_owned();
    let mut args: Vec<_> = words.filter(|word| *word != "&").map(str::to_owned).collect();
    let redirection = args.iter().position(|arg| arg == ">").map(|at| {
        let file = args.split_off(at).pop();
        file.expect("the sign is there")
    });
    Example {
        program,
        args,
        redirection,
        output: Vec::new(),
    }
}
