//! Parse, dispatch, exit.

fn main() -> std::process::ExitCode {
    misfit::cli::main()
}
