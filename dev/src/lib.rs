//! Tools of developers: measurements of kernels and of the coordinator, mechanics cases from files. No operator installs
//! them.

pub mod arguments;
pub mod kernels;
pub mod mechanics_cases;
pub mod orchestration;
