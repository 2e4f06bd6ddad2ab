//! UFACTORY xArm: up to seven joints, on TCP port 502.
