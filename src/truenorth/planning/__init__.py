"""What an array can be expected to do, before it is built: accuracy, success, reliability over a day."""
