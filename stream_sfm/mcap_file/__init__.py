"""The MCAP container: records of whole, damaged and cut-off files, in bounded time and memory."""
