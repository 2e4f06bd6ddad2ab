"""The calls of vendors' SDKs, made by this package."""
