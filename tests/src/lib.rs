//! Empty: the tests of the whole system are the test targets of this crate.
