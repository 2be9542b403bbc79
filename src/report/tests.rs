//! Pictures without NaN, names that cannot break out, and a page that says what was found.
