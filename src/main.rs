//! The command line; see `ashfall --help`.

fn main() -> std::process::ExitCode {
    ashfall::cli::main()
}
