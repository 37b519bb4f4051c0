//! Commands and flags that pages show are those of the built programs.

use std::collections::BTreeMap;

use super::texts::{documents, lines, name_of, read};

/// Checks each `PROGRAM COMMAND … --flag` of the documents against the help that `help` gets from
/// the built programs.
pub fn assert_that_they_exist(programs: &[&str], help: &dyn Fn(&str, &[&str]) -> Option<String>) {
    const MOVED: [(&str, &str); 3] = [
        ("cardiotwin", "bench"),
        ("cardiotwin-worker", "bench"),
        ("cardiotwin-worker", "benchmark"),
    ];
    // Commands in code, fenced or inline; a placeholder such as DIR or … ends the part that can be
    // checked.
    let call = regex::Regex::new(
        r"(?m)(?:^|[`/ ])(cardiotwin(?:-worker|-dev)?) ([a-z][a-z-]+)((?: [^`\n#]*)?)",
    )
    .expect("a regular expression");
    let flag = regex::Regex::new(r"(?:^|[ \[])(--[a-z][a-z-]+)").expect("a regular expression");
    let inline = regex::Regex::new(r"`([^`]+)`").expect("a regular expression");
    let mut helps: BTreeMap<String, Option<String>> = BTreeMap::new();
    let mut problems = Vec::new();
    for file in documents() {
        let text = read(&file);
        let mut code: Vec<(usize, String)> = lines(&text, true)
            .into_iter()
            .map(|(number, line)| (number, line.to_owned()))
            .collect();
        for (number, line) in lines(&text, false) {
            code.extend(
                inline
                    .captures_iter(line)
                    .map(|found| (number, found[1].to_owned())),
            );
        }
        for (number, line) in code {
            for found in call.captures_iter(&line) {
                let (program, command, rest) = (&found[1], &found[2], &found[3]);
                if !programs.contains(&program) {
                    continue;
                }
                let mut words = vec![command];
                let place = format!("{}:{number}", file.display());
                let mut known = helps
                    .entry(format!("{program} {command}"))
                    .or_insert_with(|| help(program, &words))
                    .clone();
                // A command with subcommands, such as `config show`.
                if let (Some(text), Some(second)) = (&known, rest.split_whitespace().next())
                    && text.contains("Commands:")
                {
                    words.push(second);
                    let key = format!("{program} {}", words.join(" "));
                    known = helps
                        .entry(key)
                        .or_insert_with(|| help(program, &words))
                        .clone();
                }
                let command = words.join(" ");
                let Some(known) = known else {
                    // The change log also names commands that have moved to another program.
                    if name_of(&file) == "CHANGELOG.md"
                        && MOVED.contains(&(program, command.as_str()))
                    {
                        continue;
                    }
                    problems.push(format!("{place}: {program} has no command {command}"));
                    continue;
                };
                for flag in flag.captures_iter(rest) {
                    if !known.contains(&flag[1]) {
                        problems.push(format!("{place}: {program} {command} has no {}", &flag[1]));
                    }
                }
            }
        }
    }
    assert!(
        helps.len() > 3 * programs.len(),
        "the documents show commands, but only {:?} were found",
        helps.keys()
    );
    assert!(
        problems.is_empty(),
        "commands that do not exist:\n  {}",
        problems.join("\n  ")
    );
}
