//! Commands of developers' program that pages show exist.

#[path = "../../tests/documents/commands.rs"]
mod commands;
#[path = "../../tests/documents/texts.rs"]
mod texts;

#[test]
fn commands_and_their_flags_exist() {
    let help = |_: &str, arguments: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_cardiotwin-dev"))
            .args(arguments)
            .arg("--help")
            .output()
            .expect("the program starts");
        output
            .status
            .success()
            .then(|| String::from_utf8(output.stdout).expect("help is UTF-8"))
    };
    commands::assert_that_they_exist(&["cardiotwin-dev"], &help);
}
