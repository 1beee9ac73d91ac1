//! Laws of the tendons: slack, stretch, friction with stick and slip.

pub(crate) mod transmission;
