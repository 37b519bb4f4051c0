//! The program `cardiotwin`.

use std::process::ExitCode;

fn main() -> ExitCode {
    cardiotwin::main()
}
