"""The calls of vendors' SDKs, implemented with this package."""
